"""Input-output linearization: relative degrees, decoupling matrix (15), its derivative, second feedback (20)."""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from .errors import ModelError
from .exact import canonical
from .outputs import OutputMap
from .reduction import ReducedSystem
from .samples import Sampled

SINGULAR = 1e-5  # |det Phi| at or below this times the product of Phi's row norms counts as singular, everywhere
SINGULAR_SQUARED = 1e-10  # the same for the squares, which need no root


@dataclass(frozen=True, eq=False)
class Linearization:
    """Derivatives of the outputs: of order relative_degree[i] for row i, y^(k) = drift + Phi u.

    `rate` lists the first derivatives of the rows of relative degree 2, in order.
    """

    system: ReducedSystem
    output: OutputMap
    relative_degree: tuple[int, ...]
    h: ca.SX
    rate: ca.SX
    Phi: ca.SX
    Phidot: ca.SX
    drift: ca.SX

    @cached_property
    def determinant(self) -> ca.SX:
        """det Phi."""
        return canonical(ca.det(self.Phi))

    @property
    def scale_squared(self) -> ca.SX:
        """Square of the product of Phi's row norms, which |det Phi| cannot exceed."""
        product = ca.SX(1)
        for row in range(self.Phi.shape[0]):
            product *= ca.sumsqr(self.Phi[row, :])
        return product

    def second_feedback(self, v: ca.SX) -> ca.SX:
        """u = Phi^-1 (v - drift) (20), (n-m) x 1: makes the highest derivatives equal v."""
        return ca.adj(self.Phi) @ (v - self.drift) / self.determinant


def linearize(system: ReducedSystem, output: OutputMap) -> Linearization:
    """Find each row's relative degree and build Phi, its derivative along the motion and the drift.

    A row that depends on nu has degree 1: its row of Phi is dh/dnu. A row h(q) has degree 2: dh/dq S.
    Raises ModelError when the output map is not one of this system's (`OutputMap.check`), when the rows are not n-m, when a
    row of Phi vanishes identically or when Phi is singular everywhere.
    """
    where = f"{system.mechanism.name}, output {output.name}"
    if len(output.rows) != system.freedom:
        raise ModelError(f"{where}: {len(output.rows)} outputs for n - m = {system.freedom}; give exactly as many")
    if system.freedom > 3:
        raise ModelError(f"{where}: n - m = {system.freedom}, the closed-form inverse of Phi goes up to 3")
    output.check(system)
    degree, rates, rows, drift = [], [], [], []
    h = ca.vertcat(*[row.expression for row in output.rows])
    for row, expression in zip(output.rows, ca.vertsplit(h), strict=True):
        first, first_drift = derivative(system, expression, 1)
        if not _vanishes(system, output, first):
            degree.append(1)
            rows.append(first)
            drift.append(first_drift)
            continue
        second, second_drift = derivative(system, expression, 2)
        if _vanishes(system, output, second):
            raise ModelError(
                f"{where}: row {row.name!r} of Phi vanishes identically: neither the output nor its rate "
                "feels the input (relative degree above 2, or the constraints fix the output)"
            )
        degree.append(2)
        rates.append(second @ system.nu)
        rows.append(second)
        drift.append(second_drift)
    Phi = ca.vertcat(*rows)
    _check_regular(system, output, Phi)
    Phidot = ca.densify(system.along_motion(Phi))
    return Linearization(system, output, tuple(degree), h, ca.vertcat(*rates), ca.densify(Phi), Phidot, ca.vertcat(*drift))


def derivative(system: ReducedSystem, expression: ca.SX, degree: int) -> tuple[ca.SX, ca.SX]:
    """Row of Phi and drift of the derivative of order `degree` of an output: Phi u + drift."""
    if degree == 1:
        return canonical(ca.jacobian(expression, system.nu)), system.along_motion(expression)
    row = canonical(ca.jacobian(expression, system.mechanism.q) @ system.S)
    return row, system.along_motion(row) @ system.nu


def _vanishes(system: ReducedSystem, output: OutputMap, row: ca.SX) -> bool:
    """Is this row zero at random states and parameters?"""
    return row.is_zero() or _sampled(system, output, row).largest() < 1e-12


def _sampled(system: ReducedSystem, output: OutputMap, matrix: ca.SX) -> Sampled:
    where = f"{system.mechanism.name}, output {output.name}"
    return Sampled(matrix, ca.vertcat(system.mechanism.q, system.nu), (*system.mechanism.parameters, *output.parameters), where)


def _check_regular(system: ReducedSystem, output: OutputMap, Phi: ca.SX) -> None:
    """Refuse outputs that can never be controlled together."""
    values = _sampled(system, output, Phi).values
    if any(abs(np.linalg.det(value)) > SINGULAR * np.prod(np.linalg.norm(value, axis=1)) for value in values):
        return
    where = f"{system.mechanism.name}, output {output.name}"
    for column, velocity in enumerate(system.quasi_velocities):
        if max(np.abs(value[:, column]).max() for value in values) < 1e-12:
            raise ModelError(
                f"{where}: Phi is singular everywhere: no output feels the input along {velocity.name}; "
                f"replace one by {velocity.name} itself or by an output whose rate depends on it"
            )
    names = ", ".join(row.name for row in output.rows)
    raise ModelError(f"{where}: Phi is singular everywhere: the outputs {names} depend on each other; replace one of them")
