"""Charts of instructions per call, ours compared with others."""

import json
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from noslip.model.names import LawName

BARS = {  # key in the results -> legend, colour
    "hand": ("hand-written", "#444444"),
    "instructions": ("noslip (pale: all guards)", "#d1495b"),
    "symforce": ("SymForce", "#8fb8de"),
    "casadi_single": ("CasADi, sinf by hand", "#6f9ac7"),
    "casadi": ("CasADi as emitted", "#4d7aa8"),
    "sympy": ("SymPy", "#a9c8a4"),
}
TOP = 1000  # higher bars are cut off and labelled with their number


def draw(panels: dict[str, dict], laws: list[str], path: Path) -> None:
    """Write a PNG with a panel for each title -> {law: results};
    its "Description" has the numbers of these laws, as JSON."""
    figure, axes = plt.subplots(
        len(panels), 1, figsize=(13, 4.4 * len(panels)), squeeze=False, layout="constrained"
    )
    for axis, (title, results) in zip(axes[:, 0], panels.items(), strict=True):
        _panel(axis, {law: results[law] for law in laws})
        axis.set_title(f"{title}: instructions per call of the feedback law", loc="left", fontsize=11)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, ncols=len(labels), loc="outside upper left")
    drawn = {title: {law: results[law] for law in laws} for title, results in panels.items()}
    figure.savefig(path, dpi=120, metadata={"Software": None, "Description": json.dumps(drawn)})
    plt.close(figure)


def _panel(axis, results: dict[str, dict]) -> None:
    keys = [key for key in BARS if any(key in result for result in results.values())]
    width = 0.86 / len(keys)
    for place, result in enumerate(results.values()):
        for k, key in enumerate(key for key in keys if result.get(key) is not None):
            value, (label, colour) = result[key], BARS[key]
            at = place - 0.43 + (k + 0.5) * width
            axis.bar(at, min(value, TOP), width * 0.94, color=colour, label=label if place == 0 else None)
            strong = key == "instructions"
            if strong:
                axis.bar(at, result["guards"], width * 0.94, bottom=value, color="#f0c5ca", zorder=0)
                axis.text(
                    at,
                    value + result["guards"] + 12,
                    f"+{result['guards']:.0f}",
                    ha="center",
                    fontsize=9,
                    color="#b0707a",
                )
            text = f"{value:.0f}" if value <= TOP else f"{value / 1000:.1f}k \u2191"
            axis.text(
                at,
                min(value, TOP) + 12,
                text,
                ha="center",
                fontsize=9,
                fontweight="bold" if strong else "normal",
            )
        if "hand" in result:
            axis.hlines(
                result["hand"],
                place - 0.45,
                place + 0.45,
                color="#444444",
                linewidth=0.8,
                linestyle=":",
                zorder=0,
            )
    axis.set_xticks(range(len(results)), [_title(law) for law in results])
    axis.set_ylim(0, TOP * 1.08)
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(axis="x", length=0)


def _title(law: str) -> str:
    """Return the title of a law: type_iv_line -> Type IV line."""
    name = LawName.parse(law)
    return f"Type {name.type} {name.path}".rstrip() if name else law
