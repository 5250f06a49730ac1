"""Exit codes and the names of the commands."""

BAD_INPUT, INTERNAL, READER_GONE = 2, 70, 141
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
    "export",
    "completion",
)  # each has a module in this folder
