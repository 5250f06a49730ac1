"""Runs a lesson of docs/lessons, Python with cells, and writes it as a page: text, code, what the code prints
and draws.

A cell begins with `# %%`; one of `# %% [markdown]` is text. Editors such as VS Code, Spyder and Jupyter (with
jupytext) run these files cell by cell.
"""

import contextlib
import io
import re
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot


def rendered(lesson: Path, pictures: Path) -> str:
    """The page of a lesson as Markdown; its pictures are written into the folder. Raises what the lesson
    raises."""
    parts, names = [], {"__name__": lesson.stem, "__file__": str(lesson)}
    for kind, cell in re.findall(
        r"^# %%( \[markdown\])?\n(.*?)(?=^# %%|\Z)", lesson.read_text(encoding="utf-8"), re.M | re.S
    ):
        parts.append(
            re.sub(r"^# ?", "", cell, flags=re.M) if kind else _run(cell.strip(), names, lesson, pictures)
        )
    return "\n\n".join(part.strip() for part in parts) + "\n"


def _run(code: str, names: dict, lesson: Path, pictures: Path) -> str:
    """A cell of code, what it prints, and its pictures; a picture's label says what is to be seen."""
    printed, parts = io.StringIO(), [f"```python\n{code}\n```"]
    with contextlib.redirect_stdout(printed):
        exec(compile(code, str(lesson), "exec"), names)
    if printed.getvalue():
        parts.append(f"```text\n{printed.getvalue().rstrip()}\n```")
    for number in pyplot.get_fignums():
        figure = pyplot.figure(number)
        name = f"{lesson.stem}_{len(list(pictures.glob(f'{lesson.stem}_*')))}.svg"
        figure.savefig(pictures / name, bbox_inches="tight")
        parts.append(f"![{figure.get_label()}]({name})\n\n*{figure.get_label()}.*")
        pyplot.close(figure)
    return "\n\n".join(parts)
