"""The database of canonical forms: what is damaged is not used, and nothing fails without a folder."""

import sqlite3
import subprocess
import sys
from importlib.metadata import version

import pytest
from noslip.readers import forms, kept
from noslip.readers.forms import Forms


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("NOSLIP_CACHE", str(tmp_path / "cache"))
    forms._database.cache_clear()
    yield tmp_path / "cache"
    forms._database.cache_clear()


def test_another_process_reads_what_was_written(folder):
    Forms().write("x + y", "g0 + g1")
    forms._database.cache_clear()
    assert Forms().read("x + y") == "g0 + g1" and Forms().read("x - y") is None
    code = "from noslip.readers.forms import Forms; print(Forms().read('x + y'))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "g0 + g1\n"


def test_a_damaged_text_or_file_is_not_used(folder):
    Forms().write("x + y", "g0 + g1")
    (file,) = folder.glob("*.forms")
    with sqlite3.connect(file) as database:
        database.execute("update packed_forms set packed = x'00'")
    assert Forms().read("x + y") is None
    Forms().write("x + y", "g0 + g1")
    assert Forms().read("x + y") == "g0 + g1"
    forms._database.cache_clear()
    file.write_bytes(b"no database" * 999)
    assert Forms().read("x + y") is None
    Forms().write("x + y", "g0 + g1")


def test_versions_of_libraries():
    """As their packages say."""
    assert [kept.version_of(name) for name in forms.LIBRARIES] == [version(name) for name in forms.LIBRARIES]


def test_other_code_has_other_forms(folder, monkeypatch):
    Forms().write("x + y", "g0 + g1")
    forms._database.cache_clear()
    monkeypatch.setattr(forms, "digest_of_code", lambda rooms: "of other code")
    assert Forms().read("x + y") is None


def test_without_a_private_folder_nothing_is_kept(folder, tmp_path, monkeypatch):
    Forms().write("x + y", "g0 + g1")
    (file,) = folder.glob("*.forms")
    file.chmod(0o666)
    forms._database.cache_clear()
    assert Forms().read("x + y") is None
    (tmp_path / "file").touch()
    monkeypatch.setenv("NOSLIP_CACHE", str(tmp_path / "file" / "none"))
    Forms().write("x + y", "g0 + g1")
    assert Forms().read("x + y") is None


def test_the_code_that_determines_a_form_is_there():
    root = kept.Path(kept.__file__).parent.parent
    assert all((root / folder / "exact.py").is_file() for folder in forms.DETERMINE)
