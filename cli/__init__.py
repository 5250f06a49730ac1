"""The command line: a module per command, or for a few, which parses arguments and calls the other
packages."""

DIFFERS, BAD_INPUT, INTERNAL, READER_GONE = 1, 2, 70, 141  # exit codes; those of signals are in main.py
COMMANDS = (
    "robots",
    "laws",
    "stages",
    "new",
    "import",
    "generate",
    "check",
    "evaluate",
    "simulate",
    "replay",
    "log",
    "view",
    "analyse",
    "plan",
    "outer-loop",
    "sweep",
    "figures",
    "identify",
    "calibrate",
    "excite",
    "export",
    "glossary",
    "completion",
)
MODULES = {name: name.replace("-", "_") for name in COMMANDS} | {
    "robots": "robot.robots",
    "laws": "robot.robots",
    "stages": "robot.robots",
    "new": "robot.new",
    "view": "log",
    "import": "robot.urdf",
    "identify": "robot.identify",
    "calibrate": "robot.calibrate",
    "excite": "robot.excite",
}  # in this folder
