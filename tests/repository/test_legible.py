"""The check of text in figures finds what is planted; conftest.py applies it to every figure that tests
write."""

import pytest
from matplotlib.figure import Figure
from noslip.simulation.drawing import encoded
from noslip.tests.legible import unreadable


def drawn(change) -> list[str]:
    """What is wrong with a figure after a change to its panel."""
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [0.0, 1.0], label="a line")
    axes.set(xlabel="time t (s)", ylabel="x (m)", title="a panel", xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    axes.legend(loc="upper left")
    change(axes)
    figure.draw_without_rendering()
    return unreadable(figure)


def hung_out(axes):
    axes.figure.set_layout_engine(None)
    axes.set_position((0.0, 0.1, 0.9, 0.8))


PLANTED = {
    "two texts at one place": (
        lambda axes: [axes.text(0.5, 0.5, text) for text in ("one", "other")],
        "'one' overlaps 'other'",
    ),
    "a text over the legend": (
        lambda axes: axes.text(0.02, 0.93, "a note"),
        "the legend of 'a line' overlaps 'a note'",
    ),
    "a text over a label": (lambda axes: axes.text(0.0, -0.08, "below"), "overlaps 'below'"),
    "labels of ticks": (
        lambda axes: axes.set_xticks([0.0, 0.5, 0.505], ["zero", "half", "more"]),
        "'half' overlaps 'more'",
    ),
    "a text beyond the edge": (
        lambda axes: axes.figure.text(0.95, 0.5, "far too long"),
        "'far too long' is cut at the edge",
    ),
    "a legend over a curve": (
        lambda axes: axes.legend(loc="upper right"),
        "the legend of 'a line' covers the curve 'a line'",
    ),
    "a label beyond the edge": (hung_out, "'x (m)' is cut at the edge"),
}


def test_a_figure_without_faults_passes():
    assert (
        drawn(lambda axes: axes.annotate("a point", (0.1, 0.1), (0.6, 0.2), arrowprops={"arrowstyle": "->"}))
        == []
    )


def test_what_is_not_shown_is_no_fault():
    def change(axes):
        axes.text(0.5, 0.5, "hidden", visible=False)
        axes.text(0.5, 0.5, "shown")
        axes.set_xticks([0.0, 0.5, 7.0], ["0", "a half", "out of view"])
        axes.set_xlim(0.0, 1.0)  # the ticks have widened it

    assert drawn(change) == []


@pytest.mark.parametrize("planted", PLANTED)
def test_planted_faults_are_found(planted):
    change, said = PLANTED[planted]
    assert any(said in fault for fault in drawn(change))


def test_a_figure_with_a_fault_fails_the_test_that_writes_it():
    figure = Figure()
    for text in ("one", "other"):
        figure.text(0.5, 0.5, text)
    with pytest.raises(AssertionError, match="overlaps"):
        encoded(figure, "png")
