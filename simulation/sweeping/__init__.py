"""Many closed loops with random parameters, run in batches in C,
stored as Parquet and evaluated in results/."""
