"""A vehicle on ground that moves: its robot and a SPEC."""
