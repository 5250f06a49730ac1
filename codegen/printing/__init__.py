"""From expression graphs to the text of C files."""
