"""The firmware of the vehicle of a SPEC: its numbers, and its run on this host."""
