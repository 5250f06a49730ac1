"""Reads and checks user input: robot files and TOML values; writes files completely or not at all."""
