"""A tractor that backs trailers: its robot and a SPEC."""
