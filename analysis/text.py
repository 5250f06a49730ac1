"""The result of `noslip analyse` as text."""

import textwrap
from collections.abc import Iterable

from .answers import Answer, damped_near, driven_straight, singular_when, uncontrolled
from .certification.safety import BASIS
from .exact.symbolic import written
from .flatness.flatness import Flatness
from .outputs.normal_form import NormalForm

WIDTH = 120
VERDICTS = {True: "yes", False: "no", None: "not decided"}
WORDS = (
    *("growth", "nonholonomic", "involutive", "flat output", "chained form"),
    *("relative degree", "decoupling matrix", "singularity", "zero dynamics"),
)
LONGEST = 500  # characters of a chained form
SPACE = 18  # columns before the text of a label


def as_text(answer: Answer) -> str:
    """Return constraints, then each output, then the starts;
    lines of at most WIDTH characters if words allow it."""
    lines = [f"{answer.name}: {answer.about}" if answer.about else answer.name, ""]
    lines += constraints(answer)
    lines += ["", *outputs(answer)]
    if answer.at_rest:
        lines += ["", "Underactuated, at rest", *labelled("", answer.at_rest)]
    if answer.starts:
        lines += ["", "Starts"]
        for file, verdict in answer.starts.items():
            lines += labelled(file, [str(verdict), *answer.rolling[file].summary().splitlines()])
        lines += [line for word, meaning in BASIS.items() for line in labelled(word, [meaning])]
    for file, table in answer.tables.items():
        lines += ["", f"Largest offset proved to be safe on both sides of the path, {file}", *table.lines()]
    lines += ["", *labelled("Words", [f"noslip glossary WORD explains {', '.join(WORDS)}"], 0)]
    return "\n".join(lines)


def constraints(answer: Answer) -> list[str]:
    """Return the lines about constraints and properties."""
    structure = answer.constraints
    levels = " | ".join(" ".join(level) for level in structure.levels)
    n, m, k = structure.n, structure.m, structure.k
    lines = [f"Constraints: {m} in {n} coordinates, {k} holonomic, {m - k} nonholonomic"]
    lines += labelled("growth", [f"({', '.join(map(str, structure.growth))}) of {n}: {levels}"])
    for title, parts in structure.notes.items():
        lines += labelled(title, parts)
    if structure.checks:
        lines += ["", f"Properties of {structure.controlled}"]
    for check in structure.checks:
        lines += labelled(VERDICTS[check.verdict], [f"{check.question}, on {check.where}: {check.reason}"])
    if structure.flatness or structure.no_flatness:
        lines += [
            "",
            "Flat outputs of q' = S nu",
            *labelled("", [structure.no_flatness] if structure.no_flatness else []),
        ]
    for each in structure.flatness:
        lines += _flat(each)
    return lines


def _flat(flatness: Flatness) -> list[str]:
    check, found = flatness.check, flatness.found
    source = f" ({check.reference})" if check.reference else ""
    lines = labelled(VERDICTS[check.verdict], [f"{flatness.system}: {check.reason}{source}"])
    if found is None:
        return lines + labelled("  outputs", [flatness.missing] if flatness.missing else [])
    lines += labelled(
        "  outputs", [", ".join(f"{written(output.expression)} ({output.unit})" for output in found.outputs)]
    )
    lines += labelled("  singular", [f"where {condition}" for condition in found.singular] or ["nowhere"])
    chained = ", ".join(f"z_{k + 1} = {written(z)}" for k, z in enumerate(found.chained))
    lines += labelled("  chained form", [chained] if 0 < len(chained) <= LONGEST else [])
    return lines + labelled("  robot file", [found.line])


def outputs(answer: Answer) -> list[str]:
    """Return a paragraph for each output, and the meaning of their symbols."""
    refused = [f"{', '.join(laws)}: {reason}" for reason, laws in answer.refused_by_reason.items()]
    if not answer.outputs:
        return labelled("Outputs: none", [answer.no_outputs, *(refused if len(refused) > 1 else [])], 0)
    lines, legend = ["Outputs"], dict[str, str]()
    for law, form in answer.outputs.items():
        lines += _output(law, form)
        legend |= _legend(form)
    lines += labelled("driving straight", driven_straight(answer))
    lines += labelled("not applicable", refused)
    return [*lines, *labelled("where", [f"{name} = {meaning}" for name, meaning in legend.items()])]


def _output(law: str, form: NormalForm) -> list[str]:
    decoupling = form.decoupling
    rows, degree = decoupling.linearization.output.rows, decoupling.linearization.relative_degree
    names = ", ".join(f"{row.name} ({k})" for row, k in zip(rows, degree, strict=True))
    lines = labelled(law, [f"outputs (relative degree) {names}"])
    lines += labelled("  det Phi", [written(decoupling.det_for_people)])
    lines += labelled("  singular", singular_when(form) or ["nowhere"])
    lines += labelled("  damped", damped_near(form)) if damped_near(form) else []
    lines += labelled("  not defined", [f"where {written(pole)} = 0" for pole in decoupling.poles])
    lines += labelled("  uncontrolled", [uncontrolled(form)])
    return lines + labelled("  at speed V", map(str, form.moving))


def _legend(form: NormalForm) -> dict[str, str]:
    """Return the meaning of the symbols in the formulas of this paragraph."""
    decoupling = form.decoupling
    shown = {
        str(s)
        for e in (decoupling.det_for_people, *(c.formula for c in decoupling.conditions))
        for s in e.free_symbols
    }
    meanings = {name: about for name, about in decoupling.renamed.items() if name in shown}
    if normal := decoupling.normal:
        point = [str(name) for name in normal.point]
        if shown & set(point):
            places = ", ".join(map(written, normal.point.values()))
            meanings[f"({', '.join(point)})"] = f"({places}), P_l"
        if str(normal.x) in shown:
            meanings[f"({normal.x}, {normal.y})"] = "gradient of the distance at P_l, of length 1 on the path"
    if form.moving and decoupling.planar and not decoupling.planar.heading.is_Symbol:
        meanings["heading"] = (
            f"{written(decoupling.planar.heading)}, of the part of the vehicle with P_l and its axle"
        )
    return meanings | {name: about for each in form.moving for name, about in each.symbols.items()}


def labelled(label: str, parts: Iterable[str], indent: int = 2) -> list[str]:
    """Return paragraphs after a label."""
    lines = []
    for part in parts:
        first = (" " * indent + label).ljust(SPACE - 1) + " "
        lines += textwrap.wrap(
            part,
            WIDTH,
            initial_indent=first,
            subsequent_indent=" " * SPACE,
            break_on_hyphens=False,
            break_long_words=False,
        )
        label = ""
    return lines
