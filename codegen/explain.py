"""Effect of each pass of the pipeline: operations of a law's step, pass by pass."""

import casadi as ca

from ..model.law import ControlLaw
from .costs import cycles
from .derivation.stages import inner_velocities
from .graph import count, executed
from .optimize import Optimizer
from .program import STEP, compile_law

COLUMNS = ("mul", "add", "sub", "neg", "div", "sqrt", "sincos")


def explain(law: ControlLaw) -> str:
    """Return a table of operations after every pass of a step, and what was found about the law."""
    plain, staged = (
        compile_law(law, stages=stages, optimize=False).entries[STEP].roots for stages in (False, True)
    )
    program = compile_law(law, stages=True, optimize=False)
    rows = [("the model as CasADi has it", plain), ("in short steps", staged)]
    optimized = compile_law(law)
    before, after = program.entries[STEP], optimized.entries[STEP]
    optimizer = Optimizer(program.graph, {}, before.kept if after.kept else ())
    rows += list(optimizer.passes(before.roots))
    rows.append(("in the C, where entry points share nodes", optimized.entries[STEP].roots))
    width = max(len(name) for name, _ in rows)
    lines = [f"{law.name}: {law.output.about}", *(f"  {line}" for line in _facts(law)), ""]
    lines.append(
        "  "
        + "step, operations after".ljust(width)
        + "".join(column.rjust(7) for column in COLUMNS)
        + "    sum"
    )
    for name, roots in rows:
        counted = count(executed(roots))
        total = sum(counted[column] for column in COLUMNS)
        lines.append(
            "  "
            + name.ljust(width)
            + "".join(str(counted[column]).rjust(7) for column in COLUMNS)
            + str(total).rjust(7)
        )
    lines.append(f"  constants made by init: {len(optimized.constants)}")
    of_step = cycles(optimized.entries[STEP].roots)
    lines.append(
        f"  estimated cycles of a step on cortex-m4f, without sines, cosines and guards: {of_step:.0f}"
    )
    return "\n".join(lines)


def _facts(law: ControlLaw) -> list[str]:
    system = law.system
    inner, _ = inner_velocities(system)
    state = [*system.mechanism.coordinates, *system.quasi_velocities]
    facts = []
    for name, matrix in (("S'MS", system.Mbar), ("bias", system.bias)):
        free = [q.name for q in state if not ca.depends_on(matrix, q.symbol)]
        facts.append(f"{name} does not depend on {', '.join(free)} (exact, modulo sin^2 + cos^2 = 1)")
    facts.append("quasi-velocities inside the law: " + ", ".join(q.name for q in inner.quasi_velocities))
    return facts
