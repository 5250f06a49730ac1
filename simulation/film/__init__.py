"""Films of runs, seen from above."""
