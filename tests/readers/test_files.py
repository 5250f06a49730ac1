"""What noslip did not make it neither removes nor overwrites;
what is damaged or could be another user's it does not use."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from noslip.cli.main import main
from noslip.readers import kept
from noslip.readers.errors import BadInput
from noslip.readers.files import MARK, replacing, write_folder, write_whole
from noslip.simulation.controllers import build
from noslip.simulation.sweeping.store import Parts
from noslip.simulation.sweeping.study import study_of
from noslip.tests.tools import NOSLIP

ROOT = Path(__file__).parents[2]
SPEC = (ROOT / "examples/specs/line.toml").read_text().replace("duration = 15.0", "duration = 0.5")
SWEPT = SPEC + "\n[sweep]\nseed = 7\n[sweep.plant]\nm_c = { normal = [30.0, 6.0] }\n"
SAMPLES = 40


@pytest.fixture
def sweep(tmp_path):
    """The command of a small sweep into o.parquet."""
    (tmp_path / "s.toml").write_text(SWEPT)
    return [
        "sweep",
        str(tmp_path / "s.toml"),
        "--samples",
        str(SAMPLES),
        "-o",
        str(tmp_path / "o.parquet"),
        "--jobs",
        "1",
    ]


@pytest.fixture
def parts(tmp_path, sweep):
    """Its parts, the first of them finished."""
    parts = Parts(tmp_path / "o.parquet", study_of(SWEPT, "s", SAMPLES))
    with parts.held():
        table = parts.study.plan.table(*parts.range(0))
        parts.write(0, table, parts.study.batch.run(table))
    return parts


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


# -- a sweep's folder ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["thesis.tex", "0000000", ".hidden", "sweep.txt"])
def test_a_folder_that_is_not_a_sweeps_is_refused(name, sweep, tmp_path, bad_input):
    folder = tmp_path / "o.parquet.parts"
    folder.mkdir()
    (folder / name).write_text("mine")
    assert "is not a sweep's; move it or change -o" in bad_input(sweep)


@pytest.mark.parametrize("text", ["", '{"samples": 40', "[1]", "3", "[" * 3000, "\0"])
def test_a_manifest_that_is_none_is_refused(text, sweep, tmp_path, bad_input):
    folder = tmp_path / "o.parquet.parts"
    folder.mkdir()
    (folder / "sweep.json").write_text(text)
    assert "sweep.json is damaged" in bad_input(sweep)


def test_a_link_in_the_place_of_the_folder_is_refused(sweep, parts, tmp_path, bad_input):
    parts.folder.rename(tmp_path / "elsewhere")
    parts.folder.symlink_to("elsewhere")
    assert "is a link" in bad_input(sweep)


def test_a_sweep_removes_what_it_made_and_nothing_else(sweep, parts, tmp_path, capsys):
    """Files, folders and links of others in its folder stay, and so does what the links lead to."""
    (tmp_path / "thesis.tex").write_text("mine")
    (parts.folder / "notes.txt").write_text("mine")
    (parts.folder / "0000001").symlink_to(tmp_path / "thesis.tex")
    (parts.folder / "0000009").mkdir()
    (parts.folder / ".o.parquet.0123456789ab.part").write_text("of a process that was killed")
    assert main(sweep) == 0
    assert sorted(path.name for path in parts.folder.iterdir()) == ["0000009", "notes.txt"]
    assert (tmp_path / "thesis.tex").read_text() == "mine"
    assert "files that are not the sweep's; they are left" in capsys.readouterr().err


def test_what_a_killed_merge_has_left_goes_with_the_next_run(sweep, parts, tmp_path):
    assert main(sweep) == 0
    with parts.held():
        (parts.folder / ".o.parquet.0123456789ab.part").write_text("half")
    assert main(sweep) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["o.parquet", "s.toml"]


def test_a_sweep_goes_where_a_link_leads(sweep, tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "o.parquet").symlink_to("real/o.parquet")
    assert main(sweep) == 0
    assert (tmp_path / "o.parquet").is_symlink() and [
        path.name for path in (tmp_path / "real").iterdir()
    ] == ["o.parquet"]


def test_a_damaged_part_is_computed_again(sweep, parts, tmp_path):
    """Whichever bit is not as it was written, the size the same;
    nor is a part used in the place of another."""
    file = parts.folder / "0000000"
    whole = file.read_bytes()
    random = np.random.default_rng(3)
    for byte in (0, len(whole) - 1, *random.integers(0, len(whole), 30)):
        damaged = bytearray(whole)
        damaged[byte] ^= 1 << int(random.integers(8))
        file.write_bytes(damaged)
        assert 0 in parts.missing()
        with pytest.raises(BadInput, match="damaged"):
            parts.read(0)
    shutil.copy(file, parts.folder / "0000001")
    assert main(sweep) == 0
    other = [*sweep[:-3], str(tmp_path / "other.parquet")]
    assert main(other) == 0
    assert (tmp_path / "o.parquet").read_bytes() == (tmp_path / "other.parquet").read_bytes()


def test_a_damaged_sweep_is_not_read(sweep, tmp_path, capsys):
    """Bits flipped anywhere in the file: it is refused, or what is read is what was written."""
    assert main(sweep) == 0
    file, random = tmp_path / "o.parquet", np.random.default_rng(4)
    whole, intact = file.read_bytes(), pq.read_table(tmp_path / "o.parquet")
    codes = []
    for byte in random.integers(0, len(whole), 40):
        damaged = bytearray(whole)
        damaged[byte] ^= 1 << int(random.integers(8))
        file.write_bytes(damaged)
        capsys.readouterr()
        codes.append(main(sweep))
        err = capsys.readouterr().err
        assert codes[-1] in (0, 2) and err.count("\n") == 1, (byte, err)
        if codes[-1] == 0:
            assert pq.read_table(file).equals(intact)
    assert codes.count(2) > 20
    for size in (0, 3, len(whole) // 2, len(whole) - 1):
        file.write_bytes(whole[:size])
        assert main(sweep) == 2
        assert main(["simulate", str(file), "--sample", "3", "-o", str(tmp_path / "run.csv")]) == 2


# -- other folders and files ---------------------------------------------------------------------------------


def test_stale_files_are_in_the_folder_and_as_they_were_made(tmp_path):
    """A manifest lists them: one outside, one that a link leads to, one that was edited since, stay."""
    command = ["generate", "labmate", "-o", str(tmp_path / "c"), "--scalar", "float", "--output"]
    assert main([*command, "type_i"]) == 0
    folder = tmp_path / "c/labmate"
    (tmp_path / "thesis.tex").write_text("mine")
    manifest = (folder / "manifest.json").read_text()
    digest = "7baa60a1b0f2eacbd3d0bb8ba4a1d4c3c9d7c4f4f4a5a1"  # any
    (folder / "manifest.json").write_text(
        manifest.replace('"files": {', f'"files": {{"../../thesis.tex": "{digest}",')
    )
    (folder / "labmate_type_i_f.c").write_text("edited")
    assert main([*command, "type_ii"]) == 0
    assert (tmp_path / "thesis.tex").read_text() == "mine"
    assert (folder / "labmate_type_i_f.c").read_text() == "edited" and not (
        folder / "labmate_type_i_f.h"
    ).exists()


@pytest.mark.parametrize("files", ["[]", '["../x"]', "3", "null", '{"a": {}}', "[" * 3000])
def test_a_manifest_of_another_program_is_not_overwritten(files, tmp_path, bad_input):
    (tmp_path / "labmate").mkdir()
    (tmp_path / "labmate/manifest.json").write_text(f'{{"files": {files}}}')
    (tmp_path / "labmate/labmate.h").write_text("mine")
    before = contents(tmp_path)
    assert "not written by noslip; move it" in bad_input(
        ["generate", "labmate", "-o", str(tmp_path), "--output", "type_i"]
    )
    assert contents(tmp_path) == before


def test_a_folder_is_written_whole_or_not_at_all(tmp_path):
    folder = tmp_path / "a/b"
    write_folder(folder, {"x": MARK, "y/z": b"1"})
    write_folder(folder, {"x": MARK + "2", "y/z": b"1"}, stale=["w"])
    assert contents(folder) == {"x": (MARK + "2").encode(), "y/z": b"1"}
    (folder / "mine").write_text("mine")
    with pytest.raises(BadInput, match="mine exists and was not written by noslip"):
        write_folder(folder, {"x": MARK + "3", "mine": MARK})
    assert contents(folder)["x"] == (MARK + "2").encode() and contents(folder)["mine"] == b"mine"
    (folder / "link").symlink_to(folder / "x")
    write_folder(folder, {"link": MARK + "4"})  # takes the place of the link
    assert contents(folder)["x"] == (MARK + "2").encode() and not (folder / "link").is_symlink()


def test_what_is_read_is_not_overwritten(tmp_path, bad_input):
    spec, cases, points = tmp_path / "s.toml", tmp_path / "c.json", tmp_path / "p.csv"
    spec.write_text(SPEC)
    shutil.copy(ROOT / "examples/specs/reference/labmate_paper.json", cases)
    points.write_text("0,0\n1,0\n2,1\n")
    (tmp_path / "link").symlink_to("s.toml")
    before = contents(tmp_path)
    for argv in (
        ["simulate", str(spec), "-o", str(tmp_path / "link")],
        ["simulate", str(spec), "-o", str(tmp_path / "r.csv"), "--record", str(spec)],
        ["evaluate", str(cases), "-o", str(cases)],
        ["plan", "waypoints", str(points), "--tolerance", "0.1", "-o", str(points)],
        ["analyse", "labmate", "--start", str(spec), "-o", str(spec)],
        ["sweep", str(spec), "--samples", "9", "-o", str(spec)],
    ):
        assert "would be overwritten" in bad_input(argv)
    assert contents(tmp_path) == before


def test_the_compiler_is_tried_with_the_status_alone():
    """As before a comparison with the model, which is left out where the compiler does not work."""
    assert build.shared_library({}).is_file()


@pytest.mark.nightly
def test_pictures_of_others_are_not_overwritten(sweep, tmp_path, capsys):
    """A second time over noslip's own is no error."""
    command, folder = [*sweep, "--figures", str(tmp_path / "f")], tmp_path / "f"
    folder.mkdir()
    (folder / "cloud.png").write_bytes(b"\x89PNG mine")
    assert main(command) == 2
    assert "cloud.png exists and was not written by noslip" in capsys.readouterr().err
    assert contents(folder) == {"cloud.png": b"\x89PNG mine"}
    (folder / "cloud.png").unlink()
    assert main(command) == 0
    pictures = contents(folder)
    assert all(MARK.encode() in content for content in pictures.values())
    (folder / "cloud.png").write_bytes(pictures["envelope.png"])
    assert main(command) == 0 and contents(folder) == pictures


def test_a_file_is_replaced_whole_with_its_permissions(tmp_path):
    file = tmp_path / "run.csv"
    file.write_text("old")
    file.chmod(0o640)
    (tmp_path / "link").symlink_to("run.csv")
    write_whole(tmp_path / "link", "new")
    assert (
        file.read_text() == "new"
        and file.stat().st_mode & 0o777 == 0o640
        and (tmp_path / "link").is_symlink()
    )
    with pytest.raises(ZeroDivisionError), replacing(file) as new:
        new.write_text("half")
        raise ZeroDivisionError
    assert contents(tmp_path) == {"run.csv": b"new", "link": b"new"}


def test_a_loop_of_links_is_refused(tmp_path, bad_input):
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    (tmp_path / "s.toml").write_text(SPEC)
    assert "is a link to itself" in bad_input(
        ["simulate", str(tmp_path / "s.toml"), "-o", str(tmp_path / "a")]
    )
    bad_input(["simulate", str(tmp_path / "s.toml"), "-o", str(tmp_path / "a" / "r.csv")])
    with pytest.raises(OSError):
        write_whole(tmp_path / "a", "x")
    assert (tmp_path / "a").is_symlink() and (tmp_path / "b").is_symlink()


# -- the cache of compiled laws ------------------------------------------------------------------------------

SOURCE = {"two.c": "double two(void);\ndouble two(void) { return 2.0; }\n"}


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("NOSLIP_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_a_damaged_library_is_made_anew(cache):
    library = build.shared_library(SOURCE)
    whole, random = library.read_bytes(), np.random.default_rng(5)
    for damaged in (
        b"",
        whole[: len(whole) // 2],
        *(whole[:k] + bytes([whole[k] ^ 1]) + whole[k + 1 :] for k in random.integers(0, len(whole), 6)),
    ):
        library.unlink(missing_ok=True)
        library.write_bytes(damaged)
        library = build.shared_library(SOURCE)
        assert library.read_bytes() == whole
    assert [path.name for path in cache.glob("*.so")] == [library.name]
    before = library.stat().st_mtime_ns
    assert build.shared_library(SOURCE).stat().st_mtime_ns == before


def test_a_cache_that_others_can_write_is_refused(cache):
    library = build.shared_library(SOURCE)
    assert cache.stat().st_mode & 0o777 == 0o700 and library.stat().st_mode & 0o777 == 0o700
    for path, mode in ((cache, 0o777), (cache, 0o770), (library, 0o722), (library, 0o720)):
        before = path.stat().st_mode
        path.chmod(mode)
        with pytest.raises(
            BadInput, match="can be written by others, and noslip does not execute programs of others"
        ):
            build.shared_library(SOURCE)
        path.chmod(before)
    assert build.shared_library(SOURCE) == library


@pytest.mark.parametrize("item", ["folder", "file"])
def test_a_cache_of_another_user_is_refused(item, cache, monkeypatch):
    library = build.shared_library(SOURCE)
    if os.geteuid() == 0:
        os.chown(cache if item == "folder" else library, 65534, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: 65534)
    with pytest.raises(BadInput, match="belongs to another user"):
        build.shared_library(SOURCE)


class Holder:
    """A result that refers to something that was given."""

    def __init__(self, shared: object):
        self.shared, self.numbers = shared, [1, 2, 3]


def test_results_are_remembered_until_they_are_damaged(cache, monkeypatch):
    shared, calls = object(), []

    def ask(key: str) -> Holder:
        return kept.remembered((key,), lambda: calls.append(key) or Holder(shared), shared)

    first, second = ask("a"), ask("a")
    assert calls == ["a"] and second is not first and second.shared is shared and second.numbers == [1, 2, 3]
    ask("b")
    assert calls == ["a", "b"]
    for file in cache.iterdir():
        file.write_bytes(file.read_bytes()[:-1])
    assert ask("a").shared is shared and calls == ["a", "b", "a"]
    monkeypatch.setattr(kept, "digest_of_code", lambda rooms: "of other code")
    ask("a")
    assert calls == ["a", "b", "a", "a"]
    cache.chmod(0o777)
    ask("a")  # others can write there: what they wrote is not loaded
    assert calls == ["a", "b", "a", "a", "a"]


@pytest.mark.nightly
def test_without_a_home_there_is_one_line(tmp_path):
    """Where no folder is known, and where it cannot be made."""
    environment = {k: v for k, v in os.environ.items() if k not in ("HOME", "NOSLIP_CACHE", "XDG_CACHE_HOME")}
    code = (
        "import pathlib; pathlib.Path.home = lambda: (_ for _ in ()).throw(RuntimeError('no home')); "
        f"{NOSLIP[2]}"
    )
    cases = str(ROOT / "examples/specs/reference/labmate_paper.json")
    ended = subprocess.run(
        [NOSLIP[0], "-c", code, "evaluate", cases], env=environment, capture_output=True, text=True
    )
    assert (
        ended.returncode == 2
        and ended.stderr.startswith("noslip: there is no home folder")
        and ended.stderr.count("\n") == 1
    )


# -- files from elsewhere ------------------------------------------------------------------------------------

EVIL = """from pathlib import Path
from noslip.model.robots import ROBOTS
Path(__file__).with_name("ran").write_text("")
r = ROBOTS["labmate"]
"""


@pytest.fixture
def evil(tmp_path):
    """A robot's file that leaves a trace when it runs."""
    (tmp_path / "evil.py").write_text(EVIL)
    return tmp_path / "evil.py"


def test_a_record_runs_a_robots_file_only_when_trusted(evil, tmp_path, bad_input, capsys):
    record = tmp_path / "r.txt"
    for robot in (f"{evil}:r", str(evil)):
        record.write_text(f"noslip record 1\nrobot {robot}\nlaw type_i\nmodel x\nend 0\n")
        assert "read it, then add --trust" in bad_input(["replay", str(record)])
    record.write_text(f"noslip record 1\nrobot {evil}:r\nlaw type_i\nmodel x\nend 0\n")
    assert main(["replay", str(record), "--trust"]) == 2
    assert "recorded with another model" in capsys.readouterr().err and (tmp_path / "ran").exists()


def test_a_sweeps_file_runs_a_robots_file_only_when_trusted(evil, sweep, tmp_path, bad_input):
    (tmp_path / "s.toml").write_text(SWEPT.replace('robot = "labmate"', f'robot = "{evil}:r"'))
    assert main(sweep) == 0
    (tmp_path / "ran").unlink()
    command = ["simulate", str(tmp_path / "o.parquet"), "--sample", "3", "-o", str(tmp_path / "r.csv")]
    from noslip.readers.robots import find_robot

    find_robot.cache_clear()
    assert "read it, then add --trust" in bad_input(command)
    assert main([*command, "--trust"]) == 0 and (tmp_path / "ran").exists()


def test_a_sweep_whose_spec_was_exchanged_is_refused(evil, sweep, tmp_path, bad_input):
    """The SPEC in a file is not the one that its identity is of: it is not looked at."""
    assert main(sweep) == 0
    table = pq.read_table(tmp_path / "o.parquet")
    text = SWEPT.replace('robot = "labmate"', f'robot = "{evil}:r"')
    pq.write_table(
        table.replace_schema_metadata({**table.schema.metadata, b"noslip.spec": text}), tmp_path / "o.parquet"
    )
    command = [
        "simulate",
        str(tmp_path / "o.parquet"),
        "--sample",
        "3",
        "-o",
        str(tmp_path / "r.csv"),
        "--trust",
    ]
    assert "is damaged" in bad_input(command) and not (tmp_path / "ran").exists()
