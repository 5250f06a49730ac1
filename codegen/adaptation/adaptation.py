"""C that learns parameters of a robot while it drives: the equations of (10) in them,
for recursive least squares."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ...model.algebra.exact import canonical
from ...model.errors import ModelError
from ...model.mechanism import Quantity, refuse_unknown
from ...model.reduction import ReducedSystem
from ...readers.templates import render
from ..follower.follower import fitted
from ..printing.layout import version_check
from ..printing.scalar import Scalar

NAME = "adaptation"
MOST, MOST_ROWS = 4, 4  # NOSLIP_ADAPTED, NOSLIP_ADAPTED_ROWS


def adapted_parameters(system: ReducedSystem, names: Sequence[str]) -> list[Quantity]:
    """Return the named parameters. Raises ModelError unless (10) is affine in them and determines each."""
    mechanism = system.mechanism
    known = {p.name: p for p in mechanism.parameters}
    where = f"{mechanism.name}: adaptation"
    refuse_unknown(names, known, where)
    if not names or len(set(names)) < len(names) or len(names) > MOST:
        raise ModelError(f"{where} of {', '.join(names) or 'nothing'}: name 1 to {MOST} different parameters")
    if system.dof > MOST_ROWS or not mechanism.inputs:
        raise ModelError(f"{where} is for robots with inputs and at most {MOST_ROWS} quasi-velocities")
    parameters = ca.vertcat(*[known[name].symbol for name in names])
    nudot, tau = ca.SX.sym("nudot", system.dof), ca.SX.sym("tau", len(mechanism.inputs))
    regressor = ca.jacobian(system.Mbar @ nudot + system.bias - system.input_map @ tau, parameters)
    for name in names:
        if not canonical(ca.jacobian(ca.vec(regressor), known[name].symbol)).is_zero():
            raise ModelError(
                f"{where}: the dynamics are not affine in {name}; masses and inertias can be adapted"
            )
    symbols = [ca.vertcat(*[q.symbol for q in system.state]), nudot, mechanism.p]
    at = ca.Function("at", symbols, [ca.densify(ca.substitute(regressor, parameters, 0 * parameters + 1))])
    random, nominal = np.random.default_rng(1), [p.default for p in mechanism.parameters]
    motions = [
        at(random.uniform(-1, 1, len(system.state)), random.uniform(-1, 1, system.dof), nominal)
        for _ in range(20)
    ]
    rows = np.vstack([motion.full() for motion in motions])
    largest = np.abs(rows).max(axis=0)
    if not largest.all() or np.linalg.matrix_rank(rows / largest, 1e-9) < len(names):
        raise ModelError(f"{where}: no motion tells {', '.join(names)} by themselves; leave one out")
    return [known[name] for name in names]


def adaptation_files(
    system: ReducedSystem, names: Sequence[str], scalar: Scalar, banner: Sequence[str]
) -> dict[str, str]:
    """Return file name -> text of header and source; they use the robot's dynamics. Raises ModelError as
    `adapted_parameters`."""
    robot = system.mechanism.name
    own = scalar.name(f"{robot}_{NAME}")
    values = {
        "robot": robot,
        "own": scalar.name,
        "real": scalar.real,
        "banner": banner,
        "version_check": "\n".join(version_check(f"{own}.h")),
        "parameters": system.mechanism.parameters,
        "adapted": adapted_parameters(system, names),
        "state": [q.in_c for q in system.state],
        "rates": [q.in_c for q in system.quasi_velocities],
        "inputs": [f"{q.name} ({q.unit})" for q in system.mechanism.inputs],
    }
    return {f"{own}.{kind}": fitted(render(__file__, f"adaptation.{kind}", **values)) for kind in "hc"}
