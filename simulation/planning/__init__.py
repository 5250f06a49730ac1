"""Plans paths of lines and arcs: between poses, through waypoints, from tables."""

from .biarcs import fit
from .shortest import dubins, reeds_shepp
from .smooth import fit_course
from .tables import segments_from_tables

__all__ = ["dubins", "fit", "fit_course", "reeds_shepp", "segments_from_tables"]
