"""Text of a figure that cannot be read: overlapping other text or a legend, or cut at an edge;
and legends over curves."""

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
    """Return what is wrong with the text of a figure: a sentence for each pair of boxes that overlap, each
    that is cut, and each legend that a curve runs through.

    The figure has been drawn, and its layout is kept: another one could mend what was seen. Boxes are those
    of Matplotlib's Agg renderer; the text of a legend is taken with its legend.
    """
    engine = figure.get_layout_engine()
    figure.set_layout_engine(None)
    figure.draw_without_rendering()
    figure.set_layout_engine(engine)
    renderer = RendererAgg(*figure.bbox.size, figure.dpi)
    boxes = [(name, box) for name, box in _boxes(figure, renderer) if box.width > 0 and box.height > 0]
    found = [
        f"{name} is cut at the edge of the figure" for name, box in boxes if not _within(box, figure.bbox)
    ]
    found += [
        f"{a} overlaps {b}"
        for (a, one), (b, other) in itertools.combinations(boxes, 2)
        if _overlap(one, other)
    ]
    return found + list(_covered(figure, renderer))


def _boxes(figure: Figure, renderer: RendererAgg) -> Iterator[tuple[str, Bbox]]:
    """What is shown of legends, labels of ticks and other text: a name, and the box in pixels."""
    legends = figure.findobj(Legend)
    ticks = {
        text
        for axes in figure.findobj(Axes)
        for axis in (axes.xaxis, axes.yaxis)
        for text in axis.findobj(Text)
    }
    hidden = ticks | {text for legend in legends for text in legend.findobj(Text)}
    for legend in legends:
        yield _name(legend), legend.get_window_extent(renderer)
    for text in [*_labels(figure), *(text for text in figure.findobj(Text) if text not in hidden)]:
        if text.get_visible() and text.get_text().strip():
            # Of an annotation, without its arrow
            yield repr(text.get_text()), Text.get_window_extent(text, renderer)


def _name(legend: Legend) -> str:
    return f"the legend of {legend.get_texts()[0].get_text()!r}"


def _covered(figure: Figure, renderer: RendererAgg) -> Iterator[str]:
    """Yield a sentence for each legend and each curve of its panel that runs through it, within the panel."""
    for axes in figure.findobj(Axes):
        legend = axes.get_legend()
        box = legend and Bbox.intersection(legend.get_window_extent(renderer), axes.bbox)
        for line in axes.lines if box and axes.get_visible() else ():
            if line.get_visible() and len(line.get_xdata()) and line.get_transform() == axes.transData:
                if line.get_path().transformed(line.get_transform()).intersects_bbox(box, filled=False):
                    yield f"{_name(legend)} covers the curve {line.get_label()!r}"


def _labels(figure: Figure) -> Iterator[Text]:
    """The names of the axes, and the labels of the ticks in view."""
    for axes in figure.findobj(Axes):
        for axis in (axes.xaxis, axes.yaxis) if axes.axison and axes.get_visible() else ():
            yield from (axis.label, axis.offsetText)
            low, high = sorted(axis.get_view_interval())
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                if low <= tick.get_loc() <= high:
                    yield from (tick.label1, tick.label2)


def _within(box: Bbox, edges: Bbox) -> bool:
    low, high = edges.min - SLACK, edges.max + SLACK
    return bool((box.min >= low).all() and (box.max <= high).all())


def _overlap(one: Bbox, other: Bbox) -> bool:
    common = Bbox.intersection(one, other)
    return common is not None and min(common.width, common.height) > SLACK
