"""A project as a package of CMake, PlatformIO, Arduino, Zephyr or ESP-IDF: its description, an example,
and README.md."""

from collections.abc import Mapping, Sequence

from ... import __version__
from ...model.law import ControlLaw
from ...readers.templates import render
from ..printing.scalar import Scalar
from ..project.project import starting_value
from ..targets import SAME_BITS
from ..versions import TOOLS

PACKAGES: dict[str, dict[str, str]] = {  # package manager -> file -> template
    "cmake": {
        "CMakeLists.txt": "library.cmake",
        "noslip-config.cmake": "noslip-config.cmake",
        "noslip.pc.in": "noslip.pc.in",
    },
    "platformio": {"library.json": "library.json"},
    "arduino": {"library.properties": "library.properties", "examples/Step/Step.ino": "Step.ino"},
    "zephyr": {
        "zephyr/module.yml": "module.yml",
        "zephyr/CMakeLists.txt": "zephyr.cmake",
        "zephyr/Kconfig": "zephyr.kconfig",
    },
    "esp-idf": {"CMakeLists.txt": "esp-idf.cmake", "idf_component.yml": "idf_component.yml"},
}


def package(
    manager: str, project: Mapping[str, str], laws: Sequence[ControlLaw], scalar: Scalar
) -> dict[str, str]:
    """Return file name -> text of a package for a manager of PACKAGES; `project`: the files of a firmware
    project in a scalar.

    The C is in src/, the self-test in selftest/.
    """
    law, robot = laws[0], laws[0].system.mechanism
    files = {
        name.replace("noslip/", "src/", 1): text
        for name, text in project.items()
        if name.startswith("noslip/")
    }
    files |= {name: text for name, text in project.items() if name.startswith("selftest/")}
    if manager != "arduino":
        files["examples/loop/loop.c"] = project["loop.c"]
    values = {
        "manager": manager,
        "robot": robot.name,
        "about": " ".join(robot.about.split()),
        "version": __version__,
        "tools": TOOLS,
        "flags": " ".join(SAME_BITS),
        "headers": [scalar.name(f"{robot.name}_{each.name}") + ".h" for each in laws],
        "sources": sorted(name for name in files if name.startswith("src/") and name.endswith(".c")),
        "law": f"{robot.name}_{law.name}",
        "own": scalar.name,
        "real": scalar.real,
        "inputs": law.inputs,
        "extension": law.extension,
        "period": scalar.literal(0.01),
        "config": [(q.in_c, scalar.literal(starting_value(q)), q.unit) for q in law.config],
        "gains": [(q.in_c, scalar.literal(q.default), q.unit) for q in law.gains],
    }
    templates = {**PACKAGES[manager], "README.md": "package.md"}
    return files | {name: render(__file__, template, **values) for name, template in templates.items()}
