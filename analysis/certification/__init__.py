"""Certificates of safe starts: enclosures of all motions of a closed loop with uncertain parameters."""
