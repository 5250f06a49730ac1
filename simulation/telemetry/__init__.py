"""Telemetry of a follower: a dump of its frames as ticks, as a run, as a table, and repeated bit by bit."""
