"""Makes the playground: compiles the loop of each robot to WebAssembly and writes one page that holds
everything.

python examples/playground/build.py FOLDER
"""

import base64
import gzip
import json
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca
from noslip.codegen.derivation.grip import can_grip
from noslip.codegen.files import law_program, law_text, shared_files
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.runtime import RUNTIME
from noslip.codegen.targets import STANDARD
from noslip.model.algebra.portable import portable
from noslip.model.contacts import GRAVITY, combination, unknown_loads
from noslip.model.law import ControlLaw
from noslip.model.outputs import axle
from noslip.model.reduction import ReducedSystem
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of, system_of
from noslip.simulation.controllers.targets import WASM, require
from noslip.simulation.drawing import lines_function
from noslip.simulation.guidance import vehicle_motion
from noslip.simulation.plant import functions

HERE = Path(__file__).resolve().parent
ROBOTS = (
    "labmate",
    "car",
    "forklift",
    "mecanum",
    "balancer",
    *(f"tractor_trailer:{count}" for count in range(4)),
)
PATHS = ("line", "circle", "ellipse", "segment")
LAWS = ("type_i", "type_ii", "type_iii", *(f"type_iv_{path}" for path in PATHS))
OWN_LAWS = {"mecanum": ("pose",), "balancer": ("drive",)}
EXPORTS = tuple(f"playground_{name}" for name in ("numbers", "start", "step", "headings")) + (
    "noslip_status_name",
)
# What the plant's C takes from math.h: instructions of WebAssembly, but for fmax, which there differs for
# NaN.
MATH = """#define sqrt __builtin_sqrt
#define floor __builtin_floor
#define fabs __builtin_fabs
static inline double fmax(double a, double b) { return a > b ? a : b; }
"""


def laws_of(system: ReducedSystem) -> list[ControlLaw]:
    """The laws between which the page chooses: Types I to IV, or the one of the robot's own outputs."""
    return [law_of(system, name) for name in OWN_LAWS.get(system.mechanism.name, LAWS)]


def desired_places(law: ControlLaw, unit: str = "") -> list[int]:
    """Where in the law's reference the desired values of its outputs are, of those with a unit or of all."""
    names = [quantity.name for quantity in law.reference]
    return [names.index(row.name) for row in law.output.rows if unit in ("", row.unit)]


def ahead(system: ReducedSystem) -> ca.Function:
    """How far the vehicle's point is ahead of its axle, m, as a function of the parameters;
    0 for a robot without an axle."""
    distance = ca.DM(0) if system.mechanism.name in OWN_LAWS else 0.0 - axle(system)
    return ca.Function("ahead", [system.mechanism.p], [ca.densify(distance)])


def ground(system: ReducedSystem) -> ca.Function:
    """The ground's force on each contact, along and across, N, and the mass on it, kg, as a function of
    state, inputs and parameters: C' F = -lambda, and contacts share a force in proportion to their loads
    (simulation/contact.py).
    """
    mechanism = system.mechanism
    C = combination(mechanism)
    x, p, tau = ca.vertcat(mechanism.q, system.nu), mechanism.p, ca.SX.sym("tau", len(mechanism.inputs))
    mass = ca.vertcat(*[contact.mass for contact in mechanism.contacts])
    rows, kept = (
        [k for k, part in enumerate(split(C)) if part.nnz()] for split in (ca.vertsplit, ca.horzsplit)
    )
    block, load = C[rows, kept], ca.diag(ca.vec(ca.horzcat(mass, mass).T)[rows])
    force = ca.SX(C.shape[0], 1)
    force[rows] = (
        load @ block @ ca.solve(block.T @ load @ block, -functions(system)["forces"](x, tau, p)[kept])
    )
    return portable(ca.Function("ground", [x, tau, p], [ca.densify(force), ca.densify(mass)]))


def evaluated(system: ReducedSystem) -> str:
    """The C of what is evaluated besides the law: a step of the plant, forces, the vehicle's motion,
    lines to draw."""
    generator = ca.CodeGenerator("plant.c", {"with_header": False})
    for function in (functions(system)["step"], ground(system), vehicle_motion(system), ahead(system)):
        generator.add(function)
    q, p = system.mechanism.q, system.mechanism.p
    generator.add(
        portable(ca.Function("lines", [q, p], [ca.vertcat(*lines_function(system.mechanism)(q, p))]))
    )
    return generator.dump()


def robot_header(system: ReducedSystem) -> str:
    """The text of robot.h, which playground.c includes."""
    mechanism = system.mechanism
    laws = laws_of(system)
    counts = {
        "PARAMETERS": len(mechanism.parameters),
        "STATES": len(system.state),
        "INPUTS": len(mechanism.inputs),
    }
    counts |= {
        "OUTPUTS": len(laws[0].output.rows),
        "CONTACTS": len(mechanism.contacts),
        "DEGREES": system.dof,
    }
    lines = [f'#include "{mechanism.name}_{law.name}.h"' for law in laws]
    lines += [
        "#define LAWS(X) "
        + " ".join(f"X({law.name}, {max(desired_places(law, 'rad'), default=0)})" for law in laws)
    ]
    lines += [f"#define {name} {count}" for name, count in counts.items()] + [
        f"#define GRAVITY {GRAVITY} /* m/s^2 */"
    ]
    lines += ["#define GRIPS"] * can_grip(system)
    return "\n".join([*lines, f"#define ROBOT(name) {mechanism.name}_##name", ""])


def sources(robot: str) -> dict[str, str]:
    """The C of a robot's loop that is written here: file name -> text."""
    system, scalar = system_of(find_robot(robot)), SCALARS["double"]
    files = {"plant.c": evaluated(system), "robot.h": robot_header(system), **shared_files(system, scalar)}
    for law in laws_of(system):
        files |= law_text(law_program(law), scalar).files()
    return files


def module(files: dict[str, str]) -> bytes:
    """The loop of a robot as WebAssembly, from its sources. Raises BadInput if the compiler fails."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in {**WASM.files(), "math.h": MATH, **files}.items():
            Path(folder, name).write_text(text, encoding="utf-8")
        fixed = [HERE / "playground.c", RUNTIME / "noslip_path.c", RUNTIME / "noslip_status.c"]
        compiled = [*map(str, fixed), *WASM.start, *(name for name in files if name.endswith(".c"))]
        link = ["-nostdlib", "-Wl,--no-entry,--strip-all", *(f"-Wl,--export={name}" for name in EXPORTS)]
        command = [
            *WASM.compile("clang"),
            *STANDARD,
            "-O2",
            "-I.",
            f"-I{RUNTIME}",
            *compiled,
            *link,
            "-o",
            "loop.wasm",
        ]
        result = subprocess.run(command, cwd=folder, capture_output=True, encoding="utf-8", errors="replace")
        if result.returncode:
            raise BadInput(f"clang cannot compile the playground: {result.stderr}")
        return Path(folder, "loop.wasm").read_bytes()


def layout() -> dict[str, list[int]]:
    """Where the numbers of playground.c are, in doubles from the first: name -> place, count."""
    program = (HERE / "playground.c").read_text(encoding="utf-8")
    (struct,) = re.findall(r"typedef struct numbers \{(.*?)\} numbers;", program, re.S)
    places, place = {}, 0
    for name, count in re.findall(r"^    double (\w+)(?:\[(\d+)\])?;", struct, re.M):
        places[name] = [place, int(count or 1)]
        place += int(count or 1)
    return places


def described(robot: str) -> dict:
    """What model.js knows of a robot: default parameters, counts, contacts with known loads,
    points of the lines drawn."""
    system = system_of(find_robot(robot))
    mechanism = system.mechanism
    return {
        "parameters": {p.name: p.default for p in mechanism.parameters},
        "coordinates": len(mechanism.coordinates),
        "contacts": [contact.name for contact in mechanism.contacts if not unknown_loads(mechanism)],
        "laws": {law.name: desired_places(law) for law in laws_of(system)},
        "inputs": [f"{entry.name} ({entry.unit})" for entry in mechanism.inputs],
        "states": len(system.state),
        "lines": [line.shape[1] for line in mechanism.lines],
        "grips": can_grip(system),
    }


def script() -> str:
    """The page's model.js with what it needs: the modules, compressed, the layout of their numbers,
    and the robots."""
    require("clang", "wasm-ld")
    written = [sources(robot) for robot in ROBOTS]
    with ThreadPoolExecutor(2) as pool:
        modules = dict(zip(ROBOTS, pool.map(module, written), strict=True))
    packed = {
        robot: base64.b64encode(gzip.compress(code, 9, mtime=0)).decode() for robot, code in modules.items()
    }
    constants = {
        "MODULES": packed,
        "LAYOUT": layout(),
        "ROBOTS": {robot: described(robot) for robot in ROBOTS},
    }
    model = (HERE / "model.js").read_text(encoding="utf-8")
    return "\n".join([*(f"const {k} = {json.dumps(v)};" for k, v in constants.items()), model])


def main(folder: Path) -> None:
    """Write FOLDER/index.html."""
    page, style, shown = (
        (HERE / name).read_text(encoding="utf-8") for name in ("page.html", "style.css", "page.js")
    )
    folder.mkdir(parents=True, exist_ok=True)
    page = page.replace("/* style */", style).replace("/* model */", script()).replace("/* page */", shown)
    (folder / "index.html").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]))
    except BadInput as error:
        print(f"playground: {error}", file=sys.stderr)
        sys.exit(2)
