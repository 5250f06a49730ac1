"""Exit codes and the names of the commands."""

BAD_INPUT, INTERNAL, READER_GONE = 2, 70, 141
COMMANDS = (
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
    "export",
)  # each has a module in this folder
