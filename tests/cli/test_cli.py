"""The command line itself: help, errors in one line, exit codes."""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from noslip import __version__
from noslip.cli import COMMANDS, INTERNAL, READER_GONE
from noslip.cli.main import main
from noslip.model.errors import ModelError
from noslip.readers.errors import BadInput
from noslip.tests.tools import NOSLIP

CASES = os.path.join(
    os.path.dirname(__file__), "..", "..", "examples", "specs", "reference", "labmate_paper.json"
)


def test_help_lists_the_commands(capsys):
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("usage: noslip") and all(command in out for command in COMMANDS)


def test_alone_says_how_to_begin(capsys):
    """Every command that it names exists."""
    assert main([]) == 2
    text = capsys.readouterr().err
    named = re.findall(r"^  noslip (\S+)", text, re.MULTILINE)
    assert len(named) > 2 and set(named) <= {*COMMANDS, "--help"}


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"noslip {__version__}\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(command, capsys):
    assert main([command, "--help"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"usage: noslip {command}") and f"\n  noslip {command}" in out


@pytest.mark.parametrize("command", COMMANDS)
def test_examples_have_options_that_the_help_lists(command, capsys):
    """Of `noslip plan`, that of the kind of path."""
    main([command, "--help"])
    text = capsys.readouterr().out.replace("\\\n", "")
    for example in re.findall(rf"^  (noslip {command}.*)", text, re.MULTILINE):
        words = shlex.split(example, comments=True)
        main([*words[1 : 3 if command == "plan" else 2], "--help"])
        options, _, _ = capsys.readouterr().out.partition("\nexamples:")
        for word in words:
            assert not word.startswith("--") or re.search(rf"^  (-\w.*, )?{word}\b", options, re.MULTILINE), (
                example
            )


@pytest.mark.parametrize(
    "argv",
    [
        ["--backend"],
        ["evaluate"],
        ["evaluate", "a", "b"],
        ["evaluate", "a", "--backend", "d"],
        ["check", "--states", "many"],
    ],
)
def test_wrong_command_line(argv, bad_input):
    assert "see noslip" in bad_input(argv)


@pytest.mark.parametrize(
    ("argv", "nearest"),
    [(["evaluat"], "evaluate"), (["simulate", "line", "--plto", "x.png", "-o", "x.csv"], "--plot")],
)
def test_the_nearest_name_is_suggested(argv, nearest, bad_input):
    assert f"did you mean {nearest!r}?" in bad_input(argv)


@pytest.mark.parametrize("command", ["", "evaluate", "check"], ids=lambda command: command or "all")
def test_the_command_line_does_not_import_the_model(command):
    loaded = "import sys; from noslip.cli.main import main; main(sys.argv[1:]); print(*sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", loaded, *command.split(), "--help"], capture_output=True, text=True, check=True
    )
    assert not {"casadi", "sympy", "scipy", "matplotlib", "numpy"} & set(
        result.stdout.splitlines()[-1].split()
    )


@pytest.fixture
def raising(monkeypatch):
    """Makes `noslip evaluate CASES` raise."""

    def raising(error: BaseException) -> list[str]:
        def run(args):
            raise error

        monkeypatch.setattr("noslip.cli.evaluate.run", run)
        return ["evaluate", CASES]

    return raising


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (BadInput("a.toml: no"), 2, "noslip: a.toml: no\n"),
        (BadInput("two\n  lines"), 2, "noslip: two lines\n"),
        (ModelError("robot: no inputs"), 2, "noslip: robot: no inputs\n"),
        (
            PermissionError(13, "Permission denied", "a.json"),
            2,
            "noslip: a.json: Permission denied; check its permissions\n",
        ),
        (KeyboardInterrupt(), 130, "noslip: interrupted\n"),
    ],
)
def test_errors_are_one_line(raising, capsys, error, code, line):
    assert main(raising(error)) == code
    assert capsys.readouterr().err == line


def test_an_error_of_our_own_is_one_line(raising, capsys, monkeypatch):
    monkeypatch.delenv("NOSLIP_DEBUG", raising=False)
    assert main(raising(KeyError("lost"))) == INTERNAL
    err = capsys.readouterr().err
    assert (
        err.startswith("noslip: internal error")
        and "KeyError: 'lost' (test_cli.py:" in err
        and err.count("\n") == 1
    )


def test_debugging_shows_where_it_comes_from(raising, capsys, monkeypatch):
    monkeypatch.setenv("NOSLIP_DEBUG", "1")
    assert main(raising(KeyError("lost"))) == INTERNAL
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.nightly
def test_reader_that_leaves_is_no_error():
    """The output is longer than a pipe holds, and nobody reads it."""
    read, written = os.pipe()
    os.close(read)
    result = subprocess.run(
        [*NOSLIP, "evaluate", CASES, "--backend", "casadi"], stdout=written, stderr=subprocess.PIPE, text=True
    )
    os.close(written)
    assert (result.returncode, result.stderr) == (READER_GONE, "")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
@pytest.mark.parametrize("to_file", [False, True])
def test_full_disk(to_file):
    out = ["-o", "/dev/full"] if to_file else []
    with open("/dev/full", "w", encoding="utf-8") as full:
        stdout = subprocess.DEVNULL if to_file else full
        command = [*NOSLIP, "evaluate", CASES, "--backend", "casadi", *out]
        result = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True)
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1 and "No space left on device" in result.stderr


# A process that sends itself a signal when something happens for the K-th time: a module is imported, a file
# is renamed, ...
STOPPED = """import os, sys
import signal as signals
signals.signal(signals.SIGINT, signals.default_int_handler)  # also where the tests run in the background
signal, wanted, left = int(sys.argv[1]), sys.argv[2], [int(sys.argv[3])]
def hook(event, args):
    if event == wanted and "noslip.cli.main" in sys.modules:
        left[0] -= 1
        if not left[0]:
            os.kill(os.getpid(), signal)
sys.addaudithook(hook)
from noslip.cli.main import main
del sys.argv[1:4]
sys.exit(main())
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    "event, k",
    [*(("import", k) for k in (1, 2, 9, 40, 150, 600)), ("open", 400), ("os.mkdir", 2), ("os.rename", 1)],
)
def test_a_signal_ends_at_once_and_leaves_nothing(number, event, k, tmp_path, tmp_path_factory):
    """Whenever it comes, from the first module that is imported until the files are in their place;
    nothing is cached."""
    command = [
        sys.executable,
        "-c",
        STOPPED,
        str(int(number)),
        event,
        str(k),
        "generate",
        "labmate",
        "--output",
        "type_ii",
    ]
    alone = {**os.environ, "NOSLIP_CACHE": str(tmp_path_factory.mktemp("cache"))}
    process = subprocess.run(
        [*command, "-o", str(tmp_path / "new/made")], capture_output=True, text=True, env=alone
    )
    expected = (
        [(130, "noslip: interrupted\n")] if number == signal.SIGINT else [(143, "noslip: terminated\n")]
    )
    if number == signal.SIGTERM and k <= 2:
        expected += [(-number, "")]  # nothing is there yet that could answer, or have to be removed
    assert (process.returncode, process.stderr) in expected
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", [["export", "labmate"], ["check", "--states", "100000"]])
def test_ctrl_c_from_outside(command, tmp_path):
    """Also inside CasADi, where an exception would be lost. Before the first line of noslip Python itself
    answers."""
    target = [] if command[0] == "check" else ["-o", str(tmp_path / "made")]
    process = subprocess.Popen([*NOSLIP, *command, *target], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    while "libcasadi" not in Path(f"/proc/{process.pid}/maps").read_text(encoding="utf-8"):
        time.sleep(0.005)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, b"noslip: interrupted\n")
    assert not list(tmp_path.iterdir())
