"""How many instructions a step executes on the emulated target: minimum and maximum for each kind of result.

These are instructions, not cycles.
"""

import json
import re
from collections.abc import Mapping

from . import budget
from .tools import HERE, M4F, STANDARD, Task, need, run

STATES = 4000  # of each law; a tenth in the short version
KINDS = {
    "good": "answers",
    "cut": "cuts a torque",
    "slowed": "gives up speed",
    "rolling": "answers, with NOSLIP_GRIP",
    "earning": "answers, where friction is earned",
    "noticing": "answers, where a wheel does not do what is expected",
    "gripped": "keeps the wheels rolling",
    "refused": "refuses",
}
PAGE = HERE / "README.md"  # contains the table of the budgeted numbers
OF_FEEDBACK = ("good", "cut", "refused")  # kinds
ROUTE = (
    "odometry_good",
    "odometry_refused",
    "path_line",
    "path_arc",
    "path_next",
    "path_jump",
    "path_refused",
)
SPEED = ("profile_line", "profile_arc", "slip_quiet", "slip_noticed", "slip_refused")
EKF = ("ekf_gyro", "ekf_wheels", "ekf_fix", "ekf_refused")
ADAPTATION = ("adaptation_learns", "adaptation_quiet", "adaptation_refused")
ENTRIES = {"odometry": "odometry_move", "path": "noslip_path_update_f", "ekf": "labmate_ekf_tick_f"}
ENTRIES |= {"profile": "profile_speed", "slip": "slip_tick", "adaptation": "adaptation_step"}
MACHINE = (
    "qemu-system-arm -M mps2-an386 -display none -monitor none -serial none -semihosting-config "
    "enable=on,target=native"
)


def instructions(task: Task) -> str:
    """Count the instructions of all laws, state feedbacks, odometry, path, profile, slip, filter and
    adaptation; compare with the budget.
    """
    need("qemu-system-arm", "qemu-system-arm")
    folder = task.folder / "instructions"
    folder.mkdir(parents=True, exist_ok=True)
    image = _image(task, folder)
    found = _count(task, folder, image)
    measured: budget.Numbers = {}
    for (module, kind), (least, most) in found.items():
        counted = {f"most {kind}": most} if task.short else {f"least {kind}": least, f"most {kind}": most}
        # With fewer states the minimum may exceed the budgeted one
        measured.setdefault(module, {}).update(counted)
    spread = [
        f"{module} {low} to {high}"
        for (module, kind), (low, high) in found.items()
        if kind == "good" and low != high
    ]
    said = (
        f"the same for every successful call, except {', '.join(spread)}"
        if spread
        else "the same for every successful call"
    )
    compared = budget.compare(task, M4F, measured)
    if task.update:
        PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8"), budget.FILE.read_text(encoding="utf-8")))
    return f"{said} ({len(measured)} functions)" if task.short else f"{said}; {compared}"


def with_table(page: str, numbers: str) -> str:
    """Return the page with the table of the instructions of laws,
    odometry and path that are in budget.json (its text)."""
    modules = json.loads(numbers)[M4F.name]["modules"]
    rows_of = {name.removeprefix("labmate_").removesuffix("_f"): row for name, row in sorted(modules.items())}
    laws = {law: row for law, row in rows_of.items() if "most rolling" in row}
    rows = [
        " | ".join([law.replace("_follow", ", follow"), *(_range(row, kind) for kind in KINDS)])
        for law, row in laws.items()
    ]
    head = ["Cortex-M4F, float, -O2", *KINDS]
    table = "\n".join([f"| {' | '.join(head)} |", "|---" * len(head) + "|", *(f"| {row} |" for row in rows)])
    balancer = modules.get("balancer_lqr_f", {})
    path, odometry, profile, slip = (
        modules[f"noslip_{name}_f"] for name in ("path", "odometry", "profile", "slip")
    )
    words = (
        f"Odometry {_range(odometry, 'good')}; of a path (update, which takes the heading) on a line "
        f"{_range(path, 'line')}, on an arc {_range(path, 'arc')},\nat the end of a segment "
        f"{_range(path, 'next')}, after a jump of 95 m over 5000 arcs, 64 of which end in each update, "
        f"{_range(path, 'jump')}.\nA profile of speed on a line {_range(profile, 'line')}, on an arc "
        f"{_range(profile, 'arc')};\nslip while rolling {_range(slip, 'quiet')}, where it is noticed "
        f"{_range(slip, 'noticed')}.\nState feedback of the balancer {_range(balancer, 'good')}, "
        f"{_range(balancer, 'cut')} where an input is cut, {_range(balancer, 'refused')} where it is refused."
    )
    before = r"\| Cortex-M4F, float.*?noticed \d+(?: to \d+)?\.(?:\nState feedback.*?refused\.)?"
    return re.sub(before, f"{table}\n\n{words}", page, flags=re.S)


def _range(row: Mapping[str, int], kind: str) -> str:
    least, most = row.get(f"least {kind}"), row.get(f"most {kind}")
    return "" if most is None else str(most) if least == most else f"{least} to {most}"


def _image(task: Task, folder):
    """Build a program for the board that calls all functions to be counted."""
    laws = "".join(task.driver(law, "_f", "instructions.inc") for law in task.laws)
    laws += "".join(_feedback_driver(name) for name in task.feedback_names)
    states = STATES // 10 if task.short else STATES
    calls = "".join(f"    count_{law}_f({states});\n" for law in (*task.laws, *task.feedback_names))
    calls += (
        f"    count_route({states});\n    count_jump();\n    count_ekf({states});\n    "
        f"count_adaptation({states});\n"
    )
    main = f"void count_adaptation(uint32_t n);\nint main(void)\n{{\n{calls}    return 0;\n}}\n"
    (folder / "main.c").write_text(
        f'#include "instructions.h"\n#define ROBOT labmate\n{laws}#include "instructions_route.inc"\n{main}'
    )
    boards = task.root / "firmware/boards"
    include = [f"-I{HERE / 'c'}", f"-I{task.root / 'tests/c'}"]
    objects = M4F.compile(task, task.float_sources)
    counted = [folder / "main.c", HERE / "c/instructions_adaptation.c"]
    objects += M4F.compile(task, counted, "-fno-optimize-sibling-calls", *include)
    objects += M4F.compile(
        task, [boards / "start_cortex_m.c", boards / "string.c"], "-ffreestanding", f"-I{boards}"
    )
    image = folder / "image"
    run(
        [
            M4F.compiler,
            *M4F.flags,
            "-nostdlib",
            f"-T{boards / 'mps2-an386.ld'}",
            *objects,
            "-lgcc",
            "-o",
            image,
        ]
    )
    return image


def _feedback_driver(name: str) -> str:
    sizes = {size: f"{name.upper()}_{size}" for size in ("STATES", "INPUTS")}
    defined = "".join(f"#define {macro} {value}\n" for macro, value in {"LAW": name, **sizes}.items())
    ends = "".join(f"#undef {macro}\n" for macro in ("LAW", *sizes))
    return f'#include "{name}.h"\n{defined}#include "instructions_feedback.inc"\n{ends}'


def _count(task: Task, folder, image) -> dict[tuple[str, str], tuple[int, int]]:
    """Return (module, kind of result) -> minimum and maximum number of instructions."""
    listing = run([M4F.tool("nm"), "-S", image])
    places = {
        name: (int(at, 16), int(size, 16))
        for at, size, name in re.findall(r"^(\S+) (\S+) [Tt] (\w+)$", listing, re.M)
    }
    steps = [(law, f"{law}_f", f"{law}_step_f") for law in task.laws]
    steps += [(law, f"{law}_follow_f", f"{law}_follow_f") for law in task.laws if task.follows(law)]
    selected = {(module, kind): (entry, f"{kind}_{law}_f") for law, module, entry in steps for kind in KINDS}
    for name in task.feedback_names:
        selected |= {(f"{name}_f", kind): (f"{name}_give_f", f"{kind}_{name}_f") for kind in OF_FEEDBACK}
    for name in (*ROUTE, *SPEED, *EKF, *ADAPTATION):
        module, kind = name.split("_")
        selected[f"noslip_{module}_f", kind] = ("ekf_correct" if kind == "fix" else ENTRIES[module], name)
    plugin, log = folder / "count.so", folder / "count.log"
    run(
        [
            need("gcc", "gcc"),
            *STANDARD,
            "-O2",
            "-fPIC",
            "-shared",
            task.root / "checks/bench/target/count.c",
            "-o",
            plugin,
        ]
    )
    calls = []
    for entry, caller in selected.values():
        first, size = places[caller]
        calls.append(f"call={places[entry][0] & ~1:x}:{first & ~1:x}:{(first & ~1) + size - 1:x}")
    run(
        [
            *MACHINE.split(),
            "-kernel",
            image,
            "-d",
            "plugin",
            "-D",
            log,
            "-plugin",
            ",".join([str(plugin), *calls]),
        ]
    )
    rows = [list(map(int, line.split()[1:])) for line in log.read_text(encoding="utf-8").splitlines()]
    return {
        key: (least, most) for key, (number, _, least, most, *_) in zip(selected, rows, strict=True) if number
    }
