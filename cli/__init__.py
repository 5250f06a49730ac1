"""The command line: one module per command, which parses arguments and calls the other packages."""
