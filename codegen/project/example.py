"""Files added to exported C: a Makefile, README.md, and an example program that calls the step of a law
once."""

import json
from collections.abc import Mapping

from ...model.law import ControlLaw
from ...readers.templates import render
from ..printing.scalar import SCALARS
from ..targets import STANDARD
from .project import initializers


def example(generated: Mapping[str, str], law: ControlLaw) -> dict[str, str]:
    """Return Makefile, README.md and example.c for the files of a robot;
    the example calls the step of `law`."""
    manifest = json.loads(generated["manifest.json"])
    robot, inputs = manifest["robot"], law.inputs
    suffix = "_f" if f"{robot}.h" not in generated else ""
    scalar = next(s for s in SCALARS.values() if s.suffix == suffix)
    values = {
        "robot": robot,
        "laws": list(manifest["laws"]),
        "tools": manifest["tools"],
        "law": f"{robot}_{law.name}",
        "own": scalar.name,
        "real": scalar.real,
        "inputs": inputs,
        "names": ", ".join(f"{q.name} ({q.unit})" for q in inputs),
        "printed": " ".join(["%g"] * len(inputs)),
        "values": ", ".join(f"(double)tau[{k}]" for k in range(len(inputs))),
        "state": ", ".join(
            f".{q.in_c} = {scalar.literal((k + 1) / 8)}" for k, q in enumerate(law.system.state)
        ),
        "dt": f", {scalar.literal(0.0)}" if law.extension else "",  # at the first step
        "standard": STANDARD,
        **initializers(law, scalar),
    }
    names = {"Makefile": "example.mk", "README.md": "example.md", "example.c": "example.c"}
    return {file: render(__file__, template, **values) for file, template in names.items()}
