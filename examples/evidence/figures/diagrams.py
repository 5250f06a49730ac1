"""The paper's diagrams, figures 2 to 5, redrawn: two bodies in contact, the platform, its notation,
the control scheme."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, FancyBboxPatch, Polygon, Rectangle

INK, BODY, WHEEL, ACCENT, SECOND, SLIP, SOFT = (
    "#222222",
    "#eef1f4",
    "#555555",
    "#0b61a4",
    "#c2570c",
    "#c00000",
    "#8a8f94",
)
HALF_TRACK, AHEAD, RADIUS, HALF = 0.75, 0.30, 0.15, 1.0  # m: b, d, r (assumed), half of the length a


def two_bodies() -> Figure:
    """Figure 2: two rigid bodies in contact; the velocities of their points of contact,
    when they roll and when they slip."""
    figure, (rolling, slipping) = _blank((11.0, 4.6), (-3.2, 3.2), (-2.5, 2.9), 2)
    rolls, slips = (
        "rolling: both points of contact have the same velocity",
        "slipping: their velocities differ",
    )
    for axes, text in ((rolling, rolls), (slipping, slips)):
        _draw_bodies(axes)
        axes.text(0, 2.65, text, ha="center", fontsize=11)
    same = np.array([1.7, 0.0])
    _arrow(rolling, (0, 0), same, ACCENT, r"$v_{P_1} = v_{P_2}$", same + (0.08, 0.1))
    first, second = np.array([2.1, 0.0]), np.array([0.9, 0.0])
    _arrow(slipping, (0, 0.06), first + (0, 0.06), ACCENT, "$v_{P_1}$", first + (0.08, 0.08))
    _arrow(slipping, (0, -0.06), second - (0, 0.06), SECOND, "$v_{P_2}$", second + (-0.75, -0.5))
    slip = np.array([second, first]) - (0, 0.3)
    _arrow(slipping, slip[0], slip[1], SLIP, "slip $v_{P_1} - v_{P_2}$", slip[0] + (-0.1, -0.45))
    return figure


def _draw_bodies(axes: Axes) -> None:
    """The bodies with their points of contact, which coincide, and the plane tangent to both there."""
    angle = np.linspace(0, 2 * np.pi, 200)
    upper = np.column_stack([1.75 * np.cos(angle), 1.15 + 1.15 * np.sin(angle)])
    lower = np.column_stack([2.9 * np.cos(angle), -1.15 + 1.15 * np.sin(angle)])
    for outline, name, place in ((lower, "$S_2$", (-2.1, -1.5)), (upper, "$S_1$", (-0.9, 1.5))):
        axes.add_patch(Polygon(outline, facecolor=BODY, edgecolor=INK, linewidth=1.5))
        axes.text(*place, name, fontsize=16)
    axes.plot([-3.0, 3.0], [0, 0], color=SOFT, linestyle=(0, (4, 3)), linewidth=1)
    axes.text(-3.1, 0.1, "tangent plane", color=SOFT, fontsize=9, va="bottom")
    axes.plot(0, 0, "o", color=INK, zorder=6)
    for place, name in (((-0.12, 0.3), "$P_1$ on $S_1$"), ((-0.12, -0.42), "$P_2$ on $S_2$")):
        axes.text(*place, name, fontsize=12, ha="right")


def platform() -> Figure:
    """Figure 3: the platform seen from above, with its driven wheels and castors."""
    figure, (axes,) = _blank((6.4, 4.8), (-1.9, 1.9), (-1.35, 1.5))
    _vehicle(axes, np.zeros(2), 0.0)
    for x in (-AHEAD - 0.55, HALF - AHEAD + 0.12):
        for y in (-0.5, 0.5):
            axes.add_patch(Circle((x, y), 0.07, facecolor="white", edgecolor=WHEEL, linewidth=1.5))
    axes.annotate(
        "driven wheel, DC motor",
        (-AHEAD, HALF_TRACK),
        (-1.75, 1.25),
        arrowprops={"arrowstyle": "-", "color": SOFT},
    )
    castor, place = (HALF - AHEAD + 0.12, 0.57), (0.35, 1.25)
    axes.annotate(
        "castors (ignored in the model)", castor, place, arrowprops={"arrowstyle": "-", "color": SOFT}
    )
    axes.annotate(
        "$P_o$ middle of the axle", (-AHEAD, 0), (-1.75, -1.22), arrowprops={"arrowstyle": "-", "color": SOFT}
    )
    axes.annotate(
        "$P_c$ centre of mass", (0, 0), (0.35, -1.22), arrowprops={"arrowstyle": "-", "color": SOFT}
    )
    _arrow(axes, (HALF - 0.05, 0), (HALF + 0.6, 0), ACCENT, "forward", (HALF + 0.1, 0.08))
    return figure


def notation() -> Figure:
    """Figure 4: points, lengths and angles."""
    figure, (axes,) = _blank((7.2, 6.2), (-0.6, 4.1), (-0.5, 3.6))
    heading, centre = np.radians(35), np.array([1.85, 1.5])
    ahead = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    _vehicle(axes, centre, heading)
    axle, point = centre - AHEAD * ahead, centre + 0.55 * ahead
    _arrow(axes, (0, 0), (3.9, 0), INK, "$x$", (3.92, -0.16))
    _arrow(axes, (0, 0), (0, 3.4), INK, "$y$", (-0.18, 3.35))
    _arrow(axes, axle, axle + 2.05 * ahead, ACCENT, "$X$", axle + 2.08 * ahead)
    _arrow(axes, axle, axle + 1.35 * left, ACCENT, "$Y$", axle + 1.4 * left)
    axes.plot(*np.array([axle, axle + [2.3, 0]]).T, color=SOFT, linestyle=(0, (4, 3)))
    axes.add_patch(Arc((axle[0], axle[1]), 4.0, 4.0, theta1=0, theta2=35, color=INK))
    axes.text(axle[0] + 2.02, axle[1] + 0.48, r"$\phi$", fontsize=14)
    for place, name, shift in (
        (axle, "$P_o$", (-0.02, -0.26)),
        (centre, "$P_c$", (0.1, -0.11)),
        (point, "$P_l$", (0.1, -0.1)),
    ):
        axes.plot(*place, "o", color=INK, markersize=5, zorder=6)
        axes.text(place[0] + shift[0], place[1] + shift[1], name, fontsize=13, zorder=6)
    _measure(axes, axle, centre, 0.24 * left, "$d$")
    _measure(axes, centre, point, 0.24 * left, "$L$")
    _measure(axes, axle, axle - HALF_TRACK * left, -0.28 * ahead, "$b$")
    _measure(axes, axle, axle + HALF_TRACK * left, -0.28 * ahead, "$b$")
    for name, (x, y), beside in (
        ("right wheel: radius $r$, angle $\\theta_r$", axle - HALF_TRACK * left, (1.75, 0.25)),
        ("left wheel: $\\theta_l$", axle + HALF_TRACK * left, (0.12, 2.3)),
    ):
        axes.annotate(name, (x, y), beside, arrowprops={"arrowstyle": "-", "color": SOFT})
    axes.text(0.15, 3.2, r"$q = (x_c,\, y_c,\, \phi,\, \theta_r,\, \theta_l)$", fontsize=13)
    return figure


def control_scheme() -> Figure:
    """Figure 5: linear outer loop, second feedback (20), first feedback (12), robot."""
    figure, (axes,) = _blank((10.5, 3.6), (0, 10.5), (-0.2, 3.4))
    axes.add_patch(
        Rectangle(
            (4.55, 0.62), 4.15, 2.15, facecolor="#f6f9fc", edgecolor=SOFT, linestyle="dotted", linewidth=1.5
        )
    )
    axes.text(
        6.62, 2.86, r"looks like $\dot q = S\nu,\ \dot\nu = u$ (13)", ha="center", color=SOFT, fontsize=10
    )
    boxes = {
        "linear\nfeedback": (0.75, "$v$"),
        "second nonlinear\nfeedback (20)": (2.65, "$u$"),
        "first nonlinear\nfeedback (12)": (4.8, r"$\tau$"),
        "robot (10)\n$A\\dot q=0$": (6.95, ""),
    }
    for text, (x, answer) in boxes.items():
        axes.add_patch(
            FancyBboxPatch((x, 1.1), 1.45, 1.05, boxstyle="round,pad=0.02", facecolor=BODY, edgecolor=INK)
        )
        axes.text(x + 0.725, 1.62, text, ha="center", va="center", fontsize=9)
        right = next((b for b, _ in boxes.values() if b > x), 8.95)
        _arrow(
            axes, (x + 1.47, 1.62), (right - 0.02, 1.62), INK, answer, ((x + 1.47 + right) / 2 - 0.08, 1.72)
        )
    axes.add_patch(
        FancyBboxPatch((8.97, 1.1), 0.85, 1.05, boxstyle="round,pad=0.02", facecolor=BODY, edgecolor=INK)
    )
    axes.text(9.4, 1.62, "outputs\n$h$ (14)", ha="center", va="center", fontsize=9)
    _arrow(axes, (9.84, 1.62), (10.4, 1.62), INK, "$y$", (10.15, 1.72))
    _arrow(axes, (0.05, 1.62), (0.73, 1.62), INK, "$y_d$", (0.12, 1.72))
    for x, y, name in ((8.6, 0.85, r"$q, \nu$"), (10.1, 0.1, r"$y, \dot y$")):
        axes.plot([x, x], [1.62, y], color=INK, linewidth=1.2)
        ends = [5.52, 3.37] if y > 0.5 else [1.47]
        axes.plot([x, min(ends)], [y, y], color=INK, linewidth=1.2)
        for end in ends:
            _arrow(axes, (end, y), (end, 1.08), INK)
        axes.text(x - 0.55, y + 0.07, name, fontsize=10)
    return figure


DIAGRAMS: dict[str, Callable[[], Figure]] = {
    "two-bodies": two_bodies,
    "platform": platform,
    "notation": notation,
    "control-scheme": control_scheme,
}


def _blank(
    size: tuple[float, float], x: tuple[float, float], y: tuple[float, float], count: int = 1
) -> tuple[Figure, np.ndarray]:
    """A figure with `count` sheets side by side, one unit the same length both ways."""
    figure = Figure(figsize=size, layout="constrained")
    sheets = figure.subplots(1, count, squeeze=False)[0]
    for axes in sheets:
        axes.set(xlim=x, ylim=y, aspect="equal")
        axes.axis("off")
    return figure, sheets


def _vehicle(axes: Axes, centre: np.ndarray, heading: float) -> None:
    """The platform to scale, its centre of mass at `centre`, seen from above."""
    ahead = np.array([np.cos(heading), np.sin(heading)])
    turn = np.array([ahead, [-ahead[1], ahead[0]]])
    body = np.array([[-HALF, -0.6], [HALF, -0.6], [HALF, 0.6], [-HALF, 0.6]]) - [AHEAD - 0.3, 0]
    axes.add_patch(Polygon(body @ turn + centre, facecolor=BODY, edgecolor=INK, linewidth=1.5))
    axle = np.array([[-AHEAD, -HALF_TRACK], [-AHEAD, HALF_TRACK]])
    axes.plot(*(axle @ turn + centre).T, color=WHEEL, linewidth=2)
    for side in (-1, 1):
        wheel = np.array([[-RADIUS, -0.05], [RADIUS, -0.05], [RADIUS, 0.05], [-RADIUS, 0.05]]) + [
            -AHEAD,
            side * HALF_TRACK,
        ]
        axes.add_patch(Polygon(wheel @ turn + centre, facecolor=WHEEL, edgecolor=INK, zorder=3))
    for x in (-AHEAD, 0.0):
        axes.plot(*(np.array([x, 0.0]) @ turn + centre), "o", color=INK, markersize=5, zorder=5)


def _arrow(axes: Axes, start, end, color: str, label: str = "", place=(0.0, 0.0)) -> None:
    axes.annotate(
        "",
        end,
        start,
        arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.5, "shrinkA": 0, "shrinkB": 0},
    )
    if label:
        axes.text(place[0], place[1], label, color=color, fontsize=12)


def _measure(axes: Axes, start: np.ndarray, end: np.ndarray, aside: np.ndarray, label: str) -> None:
    """A length between two points, drawn beside them."""
    axes.annotate(
        "",
        end + aside,
        start + aside,
        arrowprops={"arrowstyle": "<->", "color": SECOND, "shrinkA": 0, "shrinkB": 0},
    )
    for place in (start, end):
        axes.plot(*np.array([place, place + 1.15 * aside]).T, color=SECOND, linewidth=0.7)
    x, y = (start + end) / 2 + (1 + 0.17 / np.hypot(*aside)) * aside
    axes.text(x, y, label, color=SECOND, fontsize=12, ha="center", va="center")
