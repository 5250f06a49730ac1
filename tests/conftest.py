"""What several test files use."""

import os

import pytest
from noslip.harness.cli import main

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy comes: the tests have all cores busy without its threads


@pytest.fixture
def bad_input(capsys, tmp_path):
    """Runs a command line that must be refused: exit 2, one line on stderr, nothing on stdout, no new file. Answers the line."""

    def bad_input(argv: list[str]) -> str:
        before = sorted(tmp_path.rglob("*"))
        capsys.readouterr()
        assert main(argv) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith("noslip") and err.endswith("\n") and err.count("\n") == 1 and "Traceback" not in err
        assert sorted(tmp_path.rglob("*")) == before
        return err

    return bad_input
