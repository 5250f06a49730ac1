"""The command line: one module per command, which parses arguments and calls the other packages."""

DIFFERS, BAD_INPUT, INTERNAL, READER_GONE = 1, 2, 70, 141  # exit codes; those of signals are in main.py
COMMANDS = (
    "robots",
    "laws",
    "generate",
    "check",
    "evaluate",
    "simulate",
    "replay",
    "analyse",
    "plan",
    "outer-loop",
    "sweep",
    "figures",
    "identify",
    "export",
    "completion",
)  # each has a module in this folder
