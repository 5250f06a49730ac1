"""Every figure made once, for all tests that look at them; they run in one process, in the group `figures`."""

from functools import cache

import pytest
from noslip.harness.figures.catalogue import FIGURES
from noslip.harness.figures.production import Made, produce

in_one_process = pytest.mark.xdist_group("figures")


@cache
def made_figures() -> dict[str, Made]:
    """Figure by name."""
    return {made.figure.name: made for made in produce(FIGURES, 2, lambda made: None)}
