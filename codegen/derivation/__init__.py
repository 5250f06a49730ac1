"""The derivation from which the C is printed: the law in short steps,
in the variables that need the fewest operations."""
