"""Input-output linearization: relative degrees, decoupling matrix (15), its derivative, second feedback (20)."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from .errors import ModelError
from .exact import canonical
from .outputs import OutputMap
from .reduction import ReducedSystem

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

    @property
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
    Raises ModelError when the rows are not n-m, or when a row of Phi vanishes identically.
    """
    where = f"{system.mechanism.name}, output {output.name}"
    if len(output.rows) != system.freedom:
        raise ModelError(f"{where}: {len(output.rows)} outputs for n - m = {system.freedom}; give exactly as many")
    if system.freedom > 3:
        raise ModelError(f"{where}: n - m = {system.freedom}, the closed-form inverse of Phi goes up to 3")
    q, nu = system.mechanism.q, system.nu
    degree, rates, rows, drift = [], [], [], []
    for row in output.rows:
        rate = system.along_motion(row.expression)
        by_velocity = canonical(ca.jacobian(row.expression, nu))
        if not _vanishes(system, output, by_velocity):
            degree.append(1)
            rows.append(by_velocity)
            drift.append(rate)
            continue
        through = canonical(ca.jacobian(row.expression, q) @ system.S)
        if _vanishes(system, output, through):
            raise ModelError(
                f"{where}: row {row.name!r} of Phi vanishes identically: neither the output nor its rate "
                "feels the input (relative degree above 2, or the constraints fix the output)"
            )
        degree.append(2)
        rates.append(through @ nu)
        rows.append(through)
        drift.append(system.along_motion(through) @ nu)
    Phi = ca.vertcat(*rows)
    h = ca.vertcat(*[row.expression for row in output.rows])
    Phidot = ca.densify(system.along_motion(Phi))
    return Linearization(system, output, tuple(degree), h, ca.vertcat(*rates), ca.densify(Phi), Phidot, ca.vertcat(*drift))


def _vanishes(system: ReducedSystem, output: OutputMap, row: ca.SX) -> bool:
    """Is this row zero at random states, parameters at their defaults?"""
    if row.is_zero():
        return True
    symbols = [system.mechanism.q, system.nu, system.mechanism.p, ca.vertcat(*[c.symbol for c in output.parameters])]
    function = ca.Function("row", symbols, [ca.densify(row)])
    random = np.random.default_rng(1992)
    p = [parameter.default for parameter in system.mechanism.parameters]
    config = [parameter.default + 0.125 for parameter in output.parameters]
    samples = (random.uniform(-1.5, 1.5, symbols[0].numel() + symbols[1].numel()) for _ in range(8))
    values = [np.asarray(function(x[: q_size(system)], x[q_size(system) :], p, config)) for x in samples]
    return bool(np.nanmax(np.abs(values)) < 1e-12)


def q_size(system: ReducedSystem) -> int:
    """n, the number of coordinates."""
    return len(system.mechanism.coordinates)
