"""Text of a figure that cannot be read: overlapping other text or a legend, or cut at an edge of the figure."""

import itertools
from collections.abc import Iterator

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.text import Text
from matplotlib.transforms import Bbox

SLACK = 1.0  # pixels by which boxes may overlap: they include room around the glyphs


def unreadable(figure: Figure) -> list[str]:
    """Return what is wrong with the text of a figure, a sentence for each pair of boxes that overlap and each that is cut.

    Boxes are those that Matplotlib's Agg renderer computes after the layout. The text of a legend is taken with its legend.
    """
    figure.draw_without_rendering()
    renderer = RendererAgg(*figure.bbox.size, figure.dpi)
    boxes = [(name, box) for name, box in _boxes(figure, renderer) if box.width > 0 and box.height > 0]
    found = [f"{name} is cut at the edge of the figure" for name, box in boxes if not _within(box, figure.bbox)]
    return found + [f"{a} overlaps {b}" for (a, one), (b, other) in itertools.combinations(boxes, 2) if _overlap(one, other)]


def _boxes(figure: Figure, renderer: RendererAgg) -> Iterator[tuple[str, Bbox]]:
    """What is shown of legends, labels of ticks and other text: a name, and the box in pixels."""
    legends = figure.findobj(Legend)
    ticks = {text for axes in figure.findobj(Axes) for axis in (axes.xaxis, axes.yaxis) for text in axis.findobj(Text)}
    hidden = ticks | {text for legend in legends for text in legend.findobj(Text)}
    for legend in legends:
        yield f"the legend of {legend.get_texts()[0].get_text()!r}", legend.get_window_extent(renderer)
    for text in [*_labels(figure), *(text for text in figure.findobj(Text) if text not in hidden)]:
        if text.get_visible() and text.get_text().strip():
            yield repr(text.get_text()), text.get_window_extent(renderer)


def _labels(figure: Figure) -> Iterator[Text]:
    """The names of the axes, and the labels of the ticks in view."""
    for axes in figure.findobj(Axes):
        for axis in (axes.xaxis, axes.yaxis) if axes.axison and axes.get_visible() else ():
            yield from (axis.label, axis.offsetText)
            low, high = sorted(axis.get_view_interval())
            for minor in (False, True):
                for place, label in zip(axis.get_ticklocs(minor=minor), axis.get_ticklabels(minor=minor), strict=True):
                    if low <= place <= high:
                        yield label


def _within(box: Bbox, edges: Bbox) -> bool:
    low, high = edges.min - SLACK, edges.max + SLACK
    return bool((box.min >= low).all() and (box.max <= high).all())


def _overlap(one: Bbox, other: Bbox) -> bool:
    common = Bbox.intersection(one, other)
    return common is not None and min(common.width, common.height) > SLACK
