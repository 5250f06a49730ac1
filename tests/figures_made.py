"""Every figure made once, for all tests that look at them; they run in one process, in the group `figures`.

Each is drawn in full, but only as SVG, which holds all that is drawn: that a PNG comes of it as well is tested on a few.
"""

from contextlib import nullcontext
from functools import cache
from unittest.mock import patch

import pytest
from noslip.harness.figures import drawing, production
from noslip.harness.figures.catalogue import FIGURES
from noslip.harness.figures.framework import carry_out
from noslip.harness.figures.production import Made, produce

in_one_process = pytest.mark.xdist_group("figures")


def runs_here():
    """Within it figures' runs are carried out by this process, where the models are already: not for tests of processes."""
    return patch.object(production, "_workers", lambda count: nullcontext(carry_out))


@cache
def made_figures() -> dict[str, Made]:
    """Figure by name."""
    with runs_here(), patch.object(drawing, "METADATA", {"svg": drawing.METADATA["svg"]}):
        return {made.figure.name: made for made in produce(FIGURES, 1, lambda made: None)}
