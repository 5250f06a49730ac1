"""What a closed loop is made of: a table of stages, and what of a SPEC goes together."""
