"""A follower's config and ticks as bytes: for flash, and for telemetry."""
