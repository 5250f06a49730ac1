"""SPEC.toml: what a run is made of, read and checked."""
