"""Constraint forces body by body: what the bodies need, carried from the last body of a chain to the first.

Let every constraint slip, A qdot = slip, with quasi-velocities zero. The velocities u along which the motion
needs the efforts p (`Reduced.efforts`) are then linear in slip, and by the principle of virtual power (8)
-lambda = (du/dslip)' p. A velocity is a combination of slips and of velocities before it, which have a name:
with e for what is along each, the transpose

    e_before += row' e,    from the last velocity to the first,

takes a number of operations that grows linearly along a chain. e is the force or moment by which a body is
pulled.
"""

from collections.abc import Callable, Sequence

import casadi as ca

from ...model.contacts import unit_slips
from ...model.mechanism import Body, Mechanism
from ...model.recursion import Recursion, VelocityRow


class Transmission(Recursion):
    """The velocities of a mechanism whose constraints slip: named ones are columns of later rows,
    from n + m on."""

    def __init__(self, mechanism: Mechanism):
        self.passed: list[tuple[str, VelocityRow]] = []
        slip = ca.SX.sym("slip", len(mechanism.constraints))
        quasi = mechanism.quasi_expressions
        T = ca.SX(len(quasi), slip.numel()) if quasi else unit_slips(mechanism)
        super().__init__(mechanism, slip, T, quasi)

    def slip(self, k: int) -> VelocityRow:
        """Return the velocity of constraint k."""
        return VelocityRow({k: ca.SX(1)})

    def named(self, name: str, velocity: VelocityRow) -> VelocityRow:
        """Return the velocity as a column of its own, unless its row is short."""
        row = {j: entry for j, each in velocity.row.items() if not (entry := self._simple(each)).is_zero()}
        if len(row) < 2 and all(entry.is_leaf() for entry in row.values()):
            return VelocityRow(row)
        self.passed.append((name, VelocityRow(row)))
        return VelocityRow({self.dof + self.n + len(self.passed) - 1: ca.SX(1)})

    def reactions(self, along: Sequence[tuple[ca.SX, ca.SX]], named: Callable[[str, ca.SX], ca.SX]) -> ca.SX:
        """Return -lambda (8), m x 1, from the effort along each velocity, expressions in the rates;
        `named(name, expression)` returns a symbol for an expression."""
        efforts: dict[int, ca.SX] = {}

        def add(row: dict[int, ca.SX], effort: ca.SX) -> None:
            for j, entry in row.items():
                efforts[j] = efforts[j] + entry * effort if j in efforts else entry * effort

        for velocity, effort in along:
            add(self.velocity(velocity).row, effort)
        for k, (name, passed) in reversed(list(enumerate(self.passed))):
            column = self.dof + self.n + k
            if column in efforts:
                add(passed.row, named(f"along_{name}", efforts.pop(column)))
        return ca.vertcat(*[efforts.get(k, ca.SX(0)) for k in range(self.dof)])

    def _times(self, factor: ca.SX, velocity: VelocityRow) -> VelocityRow:
        return VelocityRow({j: factor * entry for j, entry in velocity.row.items()})

    def _add_body(self, body: Body) -> None:
        for velocity in (body.forward, body.left, body.yaw_rate):
            self.velocity(velocity)

    def _solve_set(self, equations: list[ca.SX], unknown: list[int], right: ca.SX) -> None:
        before = set(self._velocities)
        _, velocities = self._solved([self.velocity(x) for x in equations], unknown, right)
        for key in set(self._velocities) - before:
            if not self._is_known(self._velocities[key][1]):
                del self._velocities[key]
        for at, velocity in zip(unknown, velocities, strict=True):
            self.rates[at] = velocity
            self._velocities[self.qdot[at].element_hash()] = (self.qdot[at], velocity)
