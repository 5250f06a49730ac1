"""Many closed loops at once: `batch` runs them in C."""
