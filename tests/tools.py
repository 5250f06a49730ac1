"""Tools that tests run, and what becomes of a test where one is not installed."""

import sys
from collections.abc import Sequence

import pytest
from noslip.controllers.targets import missing, required

NOSLIP = [sys.executable, "-c", "import sys; from noslip.cli.main import main; sys.exit(main())"]  # the command, in a process


def skip_without(absent: Sequence[str]) -> None:
    """Skip the test if tools are absent; where they are required, it fails."""
    if absent:
        (pytest.fail if required() else pytest.skip)(f"{', '.join(absent)} not installed")


def need(*tools: str) -> str:
    """The first of these tools. Skips the test if one is absent."""
    skip_without(missing(*tools))
    return tools[0]
