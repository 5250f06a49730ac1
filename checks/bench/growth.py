"""Growth of the cost of the reduced mass matrix and the bias of a tractor with N trailers: instructions of a call, with sines.

Beside ours: a loop written by hand, CasADi's C of S'MS, and SymPy's cse of Lagrange's equations (derived here up to four
trailers, on request for all: its derivation grows with N^3).
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import casadi as ca
import chart
import numpy as np
import sympy
from measure import BENCH, COMMON, LANGUAGE, RUNTIME, _inclusive, run
from noslip.codegen.dynamics import compile_dynamics
from noslip.codegen.printing.dynamics_c import DynamicsC
from noslip.codegen.printing.robot_c import robot_header, robot_source
from noslip.codegen.printing.scalar import SCALARS
from noslip.model.algebra.expression import fold
from noslip.model.reduction import ReducedSystem, reduce
from noslip.model.robots.tractor_trailer import tractor_trailer
from noslip.readers.files import write_whole
from peers import _OPERATION
from programs import ONCE
from sympy.printing.c import C99CodePrinter

TRAILERS = (1, 2, 4, 8, 16)
DERIVED = 4  # default of the largest number of trailers for SymPy
COUNT, SEED = 256, 1992
TOLERANCE = {"double": 1e-11, "float": 1e-4}  # relative to the largest entry; only rejects wrong programs
WITHIN = 1.15  # of the hand-written loop
STEEPEST = 1.1  # exponent of N
LONGEST = 1.0  # s, to generate the C for the largest number of trailers, without imports


class Unguarded(DynamicsC):
    """Return the dynamics without guards."""

    def leave(self, condition: str, answer: str = "NOSLIP_SINGULAR") -> str:
        return "" if answer in ("NOSLIP_SINGULAR", "NOSLIP_RANGE") else super().leave(condition, answer)


def ours(system: ReducedSystem, scalar: str, guarded: bool = False) -> dict[str, str]:
    """Return the generated entry point; without guards only its computation."""
    kind = DynamicsC if guarded else Unguarded
    text = kind(compile_dynamics(system), SCALARS[scalar], ["for the bench"])
    name, robot = SCALARS[scalar].name, system.mechanism.name
    function = name(f"{robot}_dynamics_reduced") + ("" if guarded else "_law")
    source = text.source() if guarded else text.source().replace(f"static int {function}(", f"static inline int {function}(")
    parts = [robot_header(system, SCALARS[scalar], []), robot_source(system, SCALARS[scalar], []), text.header(), source]
    own = [line for part in parts for line in part.splitlines() if not line.startswith(f'#include "{robot}')]
    return {
        "declare": "\n".join(own) + f"\nstatic {text.type} dynamics;",
        "prepare": f"if ({name(f'{robot}_dynamics_init')}(&dynamics, (const {name(f'{robot}_params')} *)params) < 0) return 2;",
        "call": f"(void){function}(&dynamics, (const {text.state_type} *)state, Mbar, bias);",
    }


def hand(system: ReducedSystem, scalar: str) -> dict[str, str]:
    """Return the loop of checks/bench/hand/trailers.inc."""
    name, n = SCALARS[scalar].name, len(system.mechanism.coordinates) - 5
    return {
        "declare": f'#include "trailers.h"\nstatic {name("hand_trailers")} dynamics;',
        "prepare": f"{name('hand_trailers_init')}(&dynamics, params, {n});",
        "call": f"{name('hand_trailers_reduced')}(&dynamics, state, Mbar, bias);",
    }


def casadi(system: ReducedSystem, scalar: str) -> dict[str, str]:
    """Return CasADi's C of the textbook matrices, common subexpressions eliminated."""
    mechanism = system.mechanism
    state = ca.vertcat(mechanism.q, system.nu)
    function = ca.Function("reduced", [mechanism.p, state], ca.cse([ca.densify(x) for x in textbook(system)]))
    generator = ca.CodeGenerator("reduced.c", {"casadi_real": scalar, "casadi_int": "int"})
    generator.add(function)
    call = f"const {scalar} *in[] = {{params, state}};\n    {scalar} *out[] = {{Mbar[0], bias}};\n    reduced(in, out, 0, 0, 0);"
    return {"declare": generator.dump(), "prepare": "", "call": call}


def sympy_cse(system: ReducedSystem, scalar: str) -> dict[str, str]:
    """Return the C by SymPy: Lagrange's equations from the kinetic energy, S'MS, cse, the C99 printer."""
    mechanism = system.mechanism
    given = [*ca.vertsplit(mechanism.q), *ca.vertsplit(mechanism.qdot), *ca.vertsplit(system.nu), *ca.vertsplit(mechanism.p)]
    symbols = [sympy.Symbol(str(one)) for one in given]
    n, p = mechanism.q.numel(), system.dof
    q, qdot, nu = symbols[:n], symbols[n : 2 * n], sympy.Matrix(symbols[2 * n : 2 * n + p])
    (T,) = _in_sympy(mechanism.energy(), given, symbols)
    S = sympy.Matrix(p, n, _in_sympy(system.S, given, symbols)).T
    momentum = [T.diff(rate) for rate in qdot]
    M = sympy.Matrix(n, n, lambda i, j: momentum[i].diff(qdot[j]))
    V = sympy.Matrix([_along(a, q, qdot) - T.diff(one) for a, one in zip(momentum, q, strict=True)])
    rates = dict(zip(qdot, S * nu, strict=True))
    Sdot = S.applyfunc(lambda entry: _along(entry, q, [rates[rate] for rate in qdot]))
    bias = S.T * (M * (Sdot * nu) + V.subs(rates))
    steps, (Mbar, bias) = sympy.cse([S.T * M * S, bias], symbols=sympy.numbered_symbols("x_"))
    printer = C99CodePrinter()
    places = {str(s): f"state[{k}]" for k, s in enumerate([*q, *nu])}
    places |= {str(s): f"params[{k}]" for k, s in enumerate(symbols[2 * n + p :])}
    lines = [f"const {scalar} {name} = {place};" for name, place in places.items()]
    lines += [f"const {scalar} {name} = {printer.doprint(value)};" for name, value in steps]
    lines += [f"Mbar[{i}][{j}] = {printer.doprint(Mbar[i, j])};" for i in range(p) for j in range(p)]
    lines += [f"bias[{i}] = {printer.doprint(bias[i])};" for i in range(p)]
    return {"declare": "#include <math.h>", "prepare": "", "call": "\n    ".join(lines)}


def textbook(system: ReducedSystem) -> tuple[ca.SX, ca.SX]:
    """Return S'MS and S'(M Sdot nu + V) (10) by matrices, from the Lagrangian."""
    M = system.mechanism.M
    return system.S.T @ M @ system.S, system.S.T @ (M @ system.Sdot @ system.nu + system.V)


WAYS: dict[str, Callable[[ReducedSystem, str], dict[str, str]]] = {
    "ours": ours,
    "guarded": lambda system, scalar: ours(system, scalar, guarded=True),
    "hand": hand,
    "casadi": casadi,
    "sympy": sympy_cse,
}


def growth(folder: Path, scalars: Sequence[str] = ("double", "float"), everything: bool = False) -> dict:
    """Return instructions of a call for each scalar, method and N, the exponents of N, and the processor time to generate
    ours."""
    result: dict = {scalar: {} for scalar in scalars}
    seconds: dict[str, float] = {}
    for n in TRAILERS:
        begin = time.process_time()
        system = reduce(tractor_trailer(n))
        program = compile_dynamics(system)
        for scalar in SCALARS.values():
            DynamicsC(program, scalar, []).files()
        seconds[str(n)] = round(time.process_time() - begin, 2)
        values = _cases(system)
        for scalar in scalars:
            for way, write in WAYS.items():
                if way == "sympy" and (n > DERIVED and not everything or scalar == "float"):
                    continue
                place = folder / f"{way}_{n}_{scalar}"
                place.mkdir(parents=True, exist_ok=True)
                counted = _instructions(place, write(system, scalar), system, scalar, values)
                result[scalar].setdefault(way, {})[str(n)] = counted
    for table in result.values():
        table["exponent"] = {way: _exponents(counts) for way, counts in table.items()}
    return result | {"generation_seconds": seconds, "process_seconds": _from_process_start(TRAILERS[-1])}


def _from_process_start(trailers: int) -> float:
    """Return the processor time (s) to generate our C for both scalars, including imports."""
    code = (
        "import time; from noslip.codegen.dynamics import compile_dynamics; "
        "from noslip.codegen.printing.dynamics_c import DynamicsC; "
        "from noslip.codegen.printing.scalar import SCALARS; from noslip.model.reduction import reduce; "
        "from noslip.model.robots.tractor_trailer import tractor_trailer; "
        f"made = compile_dynamics(reduce(tractor_trailer({trailers}))); "
        "[DynamicsC(made, scalar, []).files() for scalar in SCALARS.values()]; print(time.process_time())"
    )
    return round(float(run([sys.executable, "-c", code], BENCH).stdout), 2)


def table(result: dict) -> str:
    """Return the instructions as text."""
    lines = []
    for scalar in (key for key in SCALARS if key in result):
        found = result[scalar]
        lines.append(f"\nreduced mass matrix and bias of a tractor with N trailers, {scalar}: mean instructions of a call")
        lines.append("".join(["N".ljust(10), *(str(n).rjust(10) for n in TRAILERS), "  exponent 1-16, 8-16"]))
        for way in (way for way in WAYS if way in found):
            cells = [f"{found[way][str(n)]:.0f}" if str(n) in found[way] else "" for n in TRAILERS]
            slopes = ", ".join(f"{slope:.2f}" for slope in found["exponent"][way])
            lines.append("".join([way.ljust(10), *(cell.rjust(10) for cell in cells), f"  {slopes}"]))
        ratios = [found["ours"][str(n)] / found["hand"][str(n)] for n in TRAILERS]
        lines.append("".join(["ours/hand".ljust(10), *(f"{ratio:.3f}".rjust(10) for ratio in ratios)]))
    seconds = ", ".join(f"{n}: {one}" for n, one in result["generation_seconds"].items())
    whole = result["process_seconds"]
    lines.append(f"\ngeneration, both scalars, processor seconds by N: {seconds}; N = {TRAILERS[-1]} with imports: {whole}")
    return "\n".join(lines)


def missed(result: dict) -> list[str]:
    """Return the goals that are not met."""
    longest = result["generation_seconds"][str(TRAILERS[-1])]
    found = [f"generation takes {longest} s at N = {TRAILERS[-1]}"] if longest > LONGEST else []
    for scalar in (key for key in SCALARS if key in result):
        counts = result[scalar]
        ratios = {n: counts["ours"][str(n)] / counts["hand"][str(n)] for n in TRAILERS}
        found += [f"{scalar}, N = {n}: {ratio:.3f} of the hand-written loop" for n, ratio in ratios.items() if ratio > WITHIN]
        found += [f"{scalar}: grows with N^{slope:.2f}" for slope in counts["exponent"]["ours"] if slope > STEEPEST]
    return found


def _exponents(counts: dict[str, float]) -> list[float]:
    """Return the exponents of N, from 1 and from 8 to 16 trailers, if counted."""
    pairs = [(a, b) for a, b in ((1, 16), (8, 16)) if str(a) in counts and str(b) in counts]
    return [round(math.log(counts[str(b)] / counts[str(a)]) / math.log(b / a), 3) for a, b in pairs]


def _cases(system: ReducedSystem) -> dict[str, np.ndarray]:
    mechanism, random = system.mechanism, np.random.default_rng(SEED)
    state = random.uniform(-np.pi, np.pi, (COUNT, len(system.state))).astype(np.float32).astype(float)
    params = np.float32([parameter.default for parameter in mechanism.parameters]).astype(float)
    function = ca.Function("textbook", [mechanism.p, ca.vertcat(mechanism.q, system.nu)], list(textbook(system)))
    answers = [[np.asarray(part).ravel() for part in function(params, one)] for one in state]
    return {"params": params, "state": state, "wanted": np.array([np.concatenate(answer) for answer in answers])}


def _instructions(place: Path, parts: dict[str, str], system: ReducedSystem, scalar: str, values: dict) -> float:
    """Return the instructions of a call of `parts`, by callgrind. Raises RuntimeError if its results are wrong."""
    literal = SCALARS[scalar].literal

    def array(rows: np.ndarray, kind: str) -> str:
        write = literal if kind == scalar else repr
        return "{" + ",".join("{" + ",".join(write(float(x)) for x in row) + "}" for row in rows) + "}"

    p = system.dof
    (place / "main.c").write_text(f"""#include <stddef.h>
{parts["declare"]}
static const {scalar} params[] = {array(values["params"][None], scalar)[1:-1]};
static const {scalar} states[{COUNT}][{len(system.state)}] = {array(values["state"], scalar)};
static const double wanted[{COUNT}][{p * p + p}] = {array(values["wanted"], "double" if scalar == "double" else "")};
static {scalar} Mbars[{COUNT}][{p}][{p}], biases[{COUNT}][{p}];

{ONCE} void measured(const {scalar} *params, const {scalar} *state, {scalar} (*Mbar)[{p}], {scalar} *bias)
{{
    (void)params;
    {parts["call"]}
}}

int main(void)
{{
    int i, k;
    {parts["prepare"]}
    for (i = 0; i < {COUNT}; i++) {{
        measured(params, states[i], Mbars[i], biases[i]);
    }}
    for (i = 0; i < {COUNT}; i++) {{
        for (k = 0; k < {p * p + p}; k++) {{
            const double *row = k < {p * p} ? wanted[i] : wanted[i] + {p * p};
            const int many = k < {p * p} ? {p * p} : {p};
            const double found = k < {p * p} ? Mbars[i][k / {p}][k % {p}] : biases[i][k - {p * p}];
            double size = 0, error = found - wanted[i][k];
            int j;
            for (j = 0; j < many; j++) {{
                size = row[j] > size ? row[j] : -row[j] > size ? -row[j] : size;
            }}
            if (!(error <= {TOLERANCE[scalar]} * size && -error <= {TOLERANCE[scalar]} * size)) {{
                return 1;
            }}
        }}
    }}
    return 0;
}}
""")
    flags = [flag for flag in ["-O2", *COMMON, *LANGUAGE["c"]] if "callgraph" not in flag]
    run(["gcc", *flags, f"-I{RUNTIME}", f"-I{BENCH / 'hand'}", "main.c", "-lm", "-o", "image"], place)
    command = ["valgrind", "--tool=callgrind", "-q", "--callgrind-out-file=counts", "--compress-strings=no", "--compress-pos=no"]
    done = run([*command, "./image"], place, check=False)
    if done.returncode:
        raise RuntimeError(f"{place}: exit {done.returncode}: wrong numbers {done.stderr}")
    return _inclusive((place / "counts").read_text(encoding="utf-8"))["measured"] / COUNT


def _along(expression: sympy.Expr, q: Sequence[sympy.Symbol], rates: Sequence[sympy.Expr]) -> sympy.Expr:
    """Return the time derivative of an expression in q."""
    return sum(expression.diff(one) * rate for one, rate in zip(q, rates, strict=True))


def _in_sympy(expression: ca.SX, given: Sequence[ca.SX], symbols: Sequence[sympy.Symbol]) -> list[sympy.Expr]:
    """Return the entries, column-major."""

    def number(value: float) -> sympy.Expr:
        return sympy.Integer(int(value)) if value == int(value) else sympy.Float(value)

    return fold(expression, given, lambda k: symbols[k], number, lambda code, a: _OPERATION[code](sympy, *a))


def main() -> int:
    """Print the table; return 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", dest="out", metavar="DIR", default="build", help="where growth.json and growth.png go")
    parser.add_argument("--all", action="store_true", help="derive with SymPy for all N, too (a minute or more)")
    args = parser.parse_args()
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    result = growth((out / "bench/growth").resolve(), everything=args.all)
    print(table(result))
    write_whole(out / "growth.json", json.dumps(result, indent=1) + "\n")
    chart.draw_growth(result, out / "growth.png")
    print("\n".join(missed(result)) or "within the goals")
    return int(bool(missed(result)))


if __name__ == "__main__":
    raise SystemExit(main())
