"""SPEC.toml: the definition of a run, read and checked."""
