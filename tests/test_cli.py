"""The command line itself: help, errors in one line, exit codes."""

import os
import signal
import subprocess
import sys
import time

import pytest
from noslip import __version__
from noslip.harness import cli
from noslip.harness.cli import COMMANDS, main
from noslip.harness.errors import BadInput
from noslip.model.errors import ModelError

RUN = [sys.executable, "-c", "import sys; from noslip.harness.cli import main; sys.exit(main())"]
CASES = os.path.join(os.path.dirname(__file__), "reference", "labmate_paper.json")


def test_alone_prints_help(capsys):
    assert main([]) == 0
    out = capsys.readouterr().out
    assert out.startswith("usage: noslip") and all(command in out for command in COMMANDS)


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"noslip {__version__}\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(command, capsys):
    assert main([command, "--help"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"usage: noslip {command}") and f"\n  noslip {command}" in out


@pytest.mark.parametrize(
    "argv",
    [
        ["evaluat"],
        ["--backend"],
        ["evaluate"],
        ["evaluate", "a", "b"],
        ["evaluate", "a", "--backend", "d"],
        ["check", "--states", "many"],
    ],
)
def test_wrong_command_line(argv, bad_input):
    assert "see noslip" in bad_input(argv)


@pytest.mark.parametrize("command", ["evaluate", "check"])
def test_the_command_line_does_not_import_the_model(command):
    loaded = "import sys; from noslip.harness.cli import main; main(sys.argv[1:]); print(*sys.modules)"
    result = subprocess.run([sys.executable, "-c", loaded, command, "--help"], capture_output=True, text=True, check=True)
    assert not {"casadi", "sympy", "scipy", "matplotlib"} & set(result.stdout.splitlines()[-1].split())


@pytest.fixture
def raising(monkeypatch):
    """Makes `noslip evaluate CASES` raise."""

    def raising(error: BaseException) -> list[str]:
        def run(args):
            raise error

        monkeypatch.setattr("noslip.harness.evaluate.run", run)
        return ["evaluate", CASES]

    return raising


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (BadInput("a.toml: no"), 2, "noslip: a.toml: no\n"),
        (BadInput("two\n  lines"), 2, "noslip: two lines\n"),
        (ModelError("robot: no inputs"), 2, "noslip: robot: no inputs\n"),
        (PermissionError(13, "Permission denied", "a.json"), 2, "noslip: a.json: Permission denied; check its permissions\n"),
        (KeyboardInterrupt(), 130, "noslip: interrupted\n"),
    ],
)
def test_errors_are_one_line(raising, capsys, error, code, line):
    assert main(raising(error)) == code
    assert capsys.readouterr().err == line


def test_an_error_of_our_own_is_one_line(raising, capsys, monkeypatch):
    monkeypatch.delenv("NOSLIP_DEBUG", raising=False)
    assert main(raising(KeyError("lost"))) == cli.INTERNAL
    err = capsys.readouterr().err
    assert err.startswith("noslip: internal error") and "KeyError: 'lost' (test_cli.py:" in err and err.count("\n") == 1


def test_debugging_shows_where_it_comes_from(raising, capsys, monkeypatch):
    monkeypatch.setenv("NOSLIP_DEBUG", "1")
    assert main(raising(KeyError("lost"))) == cli.INTERNAL
    assert "Traceback" in capsys.readouterr().err


def test_reader_that_leaves_is_no_error():
    """The output is longer than a pipe holds, and nobody reads it."""
    read, written = os.pipe()
    os.close(read)
    result = subprocess.run([*RUN, "evaluate", CASES, "--backend", "casadi"], stdout=written, stderr=subprocess.PIPE, text=True)
    os.close(written)
    assert (result.returncode, result.stderr) == (cli.READER_GONE, "")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
@pytest.mark.parametrize("to_file", [False, True])
def test_full_disk(to_file):
    out = ["-o", "/dev/full"] if to_file else []
    with open("/dev/full", "w") as full:
        stdout = subprocess.DEVNULL if to_file else full
        command = [*RUN, "evaluate", CASES, "--backend", "casadi", *out]
        result = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True)
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1 and "No space left on device" in result.stderr


@pytest.mark.parametrize("wait", [0.3, 0.7])
@pytest.mark.parametrize("command", [["generate", "labmate"], ["export", "labmate"], ["check", "--states", "100000"]])
def test_ctrl_c_ends_at_once_and_leaves_nothing(command, wait, tmp_path):
    """Wherever it comes, also inside CasADi, where an exception would be lost. A command may also have ended by itself."""
    target = [] if command[0] == "check" else ["-o", str(tmp_path / "made")]
    process = subprocess.Popen([*RUN, *command, *target], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    time.sleep(wait)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    if process.returncode == 0 and command[0] != "check":
        return
    assert process.returncode in (130, -signal.SIGINT)  # the latter before the command line is up
    assert err.decode() in ("noslip: interrupted\n", "") or "KeyboardInterrupt" in err.decode()
    assert not list(tmp_path.iterdir())
