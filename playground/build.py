"""Makes the playground: compiles the loop to WebAssembly and writes one page that holds everything.

python playground/build.py FOLDER
"""

import base64
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import casadi as ca
import noslip
from noslip.codegen.targets import STANDARD
from noslip.controllers.targets import WASM, require
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.plant import functions

ROOT = Path(noslip.__file__).parent
HERE = ROOT / "playground"
ROBOT = "labmate"
EXPORTS = ("playground_numbers", "playground_start", "playground_step", "noslip_status_name")
# What the plant's C takes from math.h: instructions of WebAssembly, but for fmax, which there differs for NaN.
MATH = """#define sqrt __builtin_sqrt
#define floor __builtin_floor
#define fabs __builtin_fabs
static inline double fmax(double a, double b) { return a > b ? a : b; }
"""


def plant() -> str:
    """The C of one step of the plant: that which `noslip simulate` evaluates."""
    generator = ca.CodeGenerator("plant.c", {"with_header": False})
    generator.add(functions(system_of(find_robot(ROBOT)))["step"])
    return generator.dump()


def module() -> bytes:
    """The loop as WebAssembly. Raises BadInput if a tool is missing."""
    require("clang", "wasm-ld")
    with tempfile.TemporaryDirectory() as folder:
        for name, text in {**WASM.files(), "plant.c": plant(), "math.h": MATH}.items():
            Path(folder, name).write_text(text)
        generated, runtime = ROOT / "generated" / ROBOT, ROOT / "runtime_c"
        doubles = [path for path in sorted(generated.glob("*.c")) if not path.stem.endswith(("_f", "_dynamics"))]
        sources = [
            HERE / "playground.c",
            "plant.c",
            *WASM.start,
            *doubles,
            runtime / "noslip_path.c",
            runtime / "noslip_status.c",
        ]
        link = ["-nostdlib", "-Wl,--no-entry,--strip-all", *(f"-Wl,--export={name}" for name in EXPORTS)]
        include = ["-I.", f"-I{generated}", f"-I{runtime}"]
        command = [*WASM.compile("clang"), *STANDARD, "-O2", *include, *map(str, sources), *link, "-o", "loop.wasm"]
        result = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if result.returncode:
            raise BadInput(f"clang cannot compile the playground: {result.stderr}")
        return Path(folder, "loop.wasm").read_bytes()


def layout() -> dict[str, list[int]]:
    """Where the numbers of playground.c are, in doubles from the first: name -> place, count."""
    (struct,) = re.findall(r"typedef struct numbers \{(.*?)\} numbers;", (HERE / "playground.c").read_text(), re.S)
    places, place = {}, 0
    for name, count in re.findall(r"^    double (\w+)(?:\[(\d+)\])?;", struct, re.M):
        places[name] = [place, int(count or 1)]
        place += int(count or 1)
    return places


def script() -> str:
    """The page's model.js with what it needs: the module, the layout, the robot's parameters."""
    parameters = {p.name: p.default for p in find_robot(ROBOT).parameters}
    constants = {"MODULE": base64.b64encode(module()).decode(), "LAYOUT": layout(), "PARAMETERS": parameters}
    return "\n".join([*(f"const {k} = {json.dumps(v)};" for k, v in constants.items()), (HERE / "model.js").read_text()])


def main(folder: Path) -> None:
    """Write FOLDER/index.html."""
    page, style, shown = ((HERE / name).read_text() for name in ("page.html", "style.css", "page.js"))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "index.html").write_text(page.replace("/* style */", style).replace("/* script */", f"{script()}\n{shown}"))


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]))
    except BadInput as error:
        print(f"playground: {error}", file=sys.stderr)
        sys.exit(2)
