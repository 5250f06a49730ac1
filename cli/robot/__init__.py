"""Commands about a robot itself: what there is, from a URDF, its numbers from a log."""
