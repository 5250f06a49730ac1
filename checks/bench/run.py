"""The bench: instructions, bytes and rates of the generated laws, compared with hand-written ones and those
of other tools.

Instructions are counted by callgrind on this machine and by a plugin of QEMU on an emulated Cortex-M4F, whose
cycles cycles.py estimates from them. Ours and the hand-written laws are also measured there with -Os, and as
code of a Cortex-M0+, which has no FPU. Writes bench.json and bench.png; what a missing tool would measure is
skipped and said.
"""

import argparse
import json
from pathlib import Path

import cases
import chart
import lanes
import peers
import programs
import rates
import whole_step
from measure import CortexM0Plus, CortexM4F, CortexM4FSmall, Count, Host, measure_all
from noslip.codegen.files import robot_files
from noslip.model.outputs import OUTPUTS
from noslip.readers.files import write_folder, write_whole
from noslip.readers.robots import find_robot, law_of, system_of

OURS = {
    "ours": programs.ours,
    "tested": programs.tested,
    "guarded": programs.guarded,
    "unoptimized": programs.unoptimized,
}
OURS |= {"hand": programs.hand}
PEERS = {
    "casadi": peers.casadi,
    "casadi_single": peers.casadi_single,
    "sympy": peers.sympy_cse,
    "symforce": peers.symforce,
}
MATRICES = ("Phi", "Phidot")
SCALARS = ("double", "float")


def main() -> int:
    """Run all measurements; return 0."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "-o",
        dest="out",
        metavar="DIR",
        default="build",
        help="where bench.json and bench.png go (default: build)",
    )
    much = parser.add_mutually_exclusive_group()
    much.add_argument(
        "--quick",
        action="store_true",
        help="only ours and the hand-written laws; write nothing but the tables",
    )
    much.add_argument("--all", action="store_true", help="also generation without a cache")
    args = parser.parse_args()
    out = Path(args.out)
    work = (out / "bench").resolve()
    shared = work / "shared"
    shared.mkdir(parents=True, exist_ok=True)
    system = system_of(find_robot("labmate"))
    laws = [law_of(system, name) for name in OUTPUTS]
    given = [cases.make_cases(law) for law in laws]
    write_folder(shared, robot_files(system, laws))
    for name, text in _case_files(given).items():
        write_whole(shared / name, text)

    written = _programs(laws, OURS if args.quick else OURS | PEERS)
    result: dict = {"laws": {}, "targets": {}}
    for target in (Host(work), CortexM4F(work), CortexM4FSmall(work), CortexM0Plus(work)):
        if target.missing:
            print(f"{target.name}: skipped, {target.missing} is not installed")
            continue
        with_peers = target.peers and target.has_libm
        if target.peers and not (with_peers or args.quick):
            print(f"{target.name}: laws of other tools are skipped, newlib is not installed")
        scalars = ("float",) if isinstance(target, CortexM4F) else SCALARS
        measured = written if with_peers else {key: found for key, found in written.items() if key[0] in OURS}
        jobs = [(label, found, scalar) for (label, scalar), found in measured.items() if scalar in scalars]
        counts = measure_all(target, jobs, shared)
        for scalar in scalars:
            table = {law.name: _entry(law.name, scalar, counts) for law in laws}
            print(_table(f"{target.name}, {scalar}", table))
            if isinstance(target, CortexM4F):
                result["targets"][target.name] = table
            else:
                for law, entry in table.items():
                    result["laws"].setdefault(law, {})[scalar] = entry
    if found := result["targets"].get(CortexM4F.name):
        found["whole_step"] = whole_step.measure(work / "whole_step")
        print(f"\n{whole_step.text(found['whole_step'])}")
    if result["laws"]:
        result["lanes"] = lanes.measure(laws, shared, work / "lanes")
        print(f"\n{lanes.table(result['lanes'])}")
    if args.quick:
        return 0

    result["simulation"] = rates.simulation()
    result["generation"] = rates.generation(cold=args.all)
    print(_rates(result))
    write_whole(out / "bench.json", json.dumps(result, indent=1) + "\n")
    print(f"{out}/bench.json")
    if panels := _panels(result):
        chart.draw(panels, list(programs.HAND), out / "bench.png")
        print(f"{out}/bench.png")
    return 0


def _case_files(given: list[cases.Cases]) -> dict[str, str]:
    files = {f"cases_{scalar}.h": cases.header(given, scalar) for scalar in SCALARS}
    return files | {
        f"cases_{c.law.name}_{scalar}.c": cases.source(c, scalar) for c in given for scalar in SCALARS
    }


def _programs(
    laws: list, ways: dict[str, programs.Writer]
) -> dict[tuple[str, str], list[programs.MeasuredProgram]]:
    """Return (method, scalar) -> programs: ours for every law,
    others for laws with a hand-written version."""
    written: dict[tuple[str, str], list[programs.MeasuredProgram]] = {}
    for label, way in ways.items():
        if why := peers.missing(label):
            print(f"{label}: skipped, {why}")
            continue
        for scalar in SCALARS:
            if label == "casadi_single" and scalar == "double":
                continue
            ours = label in OURS and label != "hand"
            chosen = [law for law in laws if ours or law.name in programs.HAND]
            quantities = ("tau", *MATRICES) if label in ("ours", "hand") else ("tau",)
            made = [
                (law, q, peers.capped(lambda w=way, a=(law, scalar, q): w(*a)))
                for law in chosen
                for q in quantities
            ]
            for law, _, _ in (one for one in made if one[2] is None):
                print(f"{label}, {law.name}, {scalar}: given up after {peers.CAP} s")
            written[label, scalar] = [program for _, _, program in made if program is not None]
    return written


def _entry(law: str, scalar: str, counts: dict) -> dict:
    """Return all results of a law on a target: instructions of a call, code and stack bytes."""
    found: dict[str, Count] = {}
    for (label, of), programs_counted in counts.items():
        if of == scalar and f"{law}_tau" in programs_counted:
            found[label] = programs_counted[f"{law}_tau"]
    ours, tested, guarded = (found.pop(label) for label in ("ours", "tested", "guarded"))
    entry: dict = {"instructions": ours.mean, "guards": round(guarded.instructions - ours.instructions, 2)}
    if ours.most is not None:
        entry |= {"least": ours.least, "most": ours.most, "most_with_guards": guarded.most}
    if ours.cycles is not None:
        entry |= {"cycles": tested.cycles, "cycles_unguarded": ours.cycles, "cycles_guarded": guarded.cycles}
        entry |= {f"cycles_{label}": count.cycles for label, count in found.items()}
    entry |= {label: count.mean for label, count in found.items()}
    entry |= {"text_bytes": ours.text_bytes, "stack_bytes": ours.stack_bytes}
    found = {"with_guards": guarded} | found
    entry["bytes"] = {
        label: {"text": count.text_bytes, "stack": count.stack_bytes} for label, count in found.items()
    }
    for quantity in MATRICES:
        name = f"{law}_{quantity}"
        entry[quantity] = {"instructions": counts["ours", scalar][name].mean}
        if name in counts["hand", scalar]:
            entry[quantity]["hand"] = counts["hand", scalar][name].mean
    return entry


def _table(title: str, table: dict[str, dict]) -> str:
    """Return tables of instructions and bytes of all laws."""
    columns = [
        key
        for key in ("instructions", "guards", *OURS, *PEERS)
        if any(key in entry for entry in table.values())
    ]
    rows = [["", *columns, "ours/hand", "Phi/hand", "Phidot/hand"]]
    for law, entry in table.items():
        ratios = [_ratio(entry["instructions"], entry.get("hand"))]
        ratios += [_ratio(entry[q]["instructions"], entry[q].get("hand")) for q in MATRICES]
        rows.append([law, *(_number(entry.get(key)) for key in columns), *ratios])
    ways = list(next(iter(table.values()))["bytes"])
    sizes = [["", "ours", *ways]]
    for law, entry in table.items():
        each = [entry["bytes"].get(label) for label in ways]
        cells = [f"{one['text']}+{one['stack']}" if one else "" for one in each]
        sizes.append([law, f"{entry['text_bytes']}+{entry['stack_bytes']}", *cells])
    note = "text + stack bytes, without libm"
    counted = (
        f"\n{title}: mean instructions of a call\n{_aligned(rows)}\n\n{title}: {note}\n{_aligned(sizes)}"
    )
    return counted + _cycles(title, table)


def _cycles(title: str, table: dict[str, dict]) -> str:
    """Return a table of the estimated cycles of all laws; nothing for a target without an estimate."""
    columns = {"cycles_unguarded": "law alone", "cycles": "+ singular test", "cycles_guarded": "+ all guards"}
    columns |= {f"cycles_{label}": label for label in ("unoptimized", "hand", *PEERS)}
    columns = {
        key: heading for key, heading in columns.items() if any(key in entry for entry in table.values())
    }
    rows = [["", *columns.values()]]
    rows += [[law, *(_number(entry.get(key)) for key in columns)] for law, entry in table.items()]
    return f"\n\n{title}: estimated cycles of a call\n{_aligned(rows)}" if columns else ""


def _ratio(ours: float, hand: float | None) -> str:
    return f"{ours / hand:.2f}" if hand else ""


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.1f}"


def _aligned(rows: list[list[str]]) -> str:
    full = [row + [""] * (max(map(len, rows)) - len(row)) for row in rows]
    widths = [max(len(row[k]) for row in full) for k in range(len(full[0]))]
    return "\n".join(
        "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]).rstrip() for row in full
    )


def _rates(result: dict) -> str:
    generated = (
        f"generation of all laws, both scalars, from process start: {result['generation']['seconds']} s\n"
    )
    if found := result["generation"].get("cold_processor_seconds"):
        cold = ", ".join(f"{robot} {seconds}" for robot, seconds in found.items())
        generated += f"without a cache, processor seconds: {cold}\n"
    times = ", ".join(f"{name} {seconds} s" for name, seconds in result["simulation"].items())
    return f"{generated}a second of a simulated run: {times}\n"


def _panels(result: dict) -> dict[str, dict]:
    panels = {"Cortex-M4F, float": result["targets"].get("cortex-m4f")}
    for scalar in SCALARS:
        if result["laws"]:
            panels[f"x86-64, {scalar}"] = {law: entry[scalar] for law, entry in result["laws"].items()}
    return dict([panel for panel in panels.items() if panel[1]][:2])


if __name__ == "__main__":
    raise SystemExit(main())
