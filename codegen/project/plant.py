"""The robot that the firmware of a vehicle drives in its test: C in double of what the rows of a run show."""

from collections.abc import Sequence

import casadi as ca

from ...model.contacts import GRAVITY, ground
from ...model.law import ControlLaw, symbols
from ...model.mechanism import Quantity, quantity
from ..graph import Graph, Group, Leaf, Node, free_name, from_casadi, reachable
from ..printing.layout import body
from ..printing.scalar import DOUBLE
from ..printing.statements import Statements

OWN = ("x", "xdot", "tau", "nudot", "place", "y", "force", "load", "robot")  # names of arguments


class PlantC:
    """Bodies of C functions of a robot's state x = [q; nu] (11), in SI, without the optimizer: the operations
    are the model's.

    The parameters are members of the struct `robot`. With `drives` whose own loops determine the rates of the
    quasi-velocities, these are given as `nudot`, otherwise the inputs are, as `tau`.
    """

    def __init__(self, law: ControlLaw, drives: bool):
        self._law, self._system = law, law.system
        self._nudot = [quantity(f"{v.name}_rate", "") for v in self._system.quasi_velocities]
        self._tau = symbols(self._system.mechanism.inputs)
        self._acceleration = symbols(self._nudot) if drives else self._system.acceleration(self._tau)

    @property
    def rate(self) -> str:
        """The rates of the state (11), `xdot`."""
        return self._body("xdot", ca.vertcat(self._system.qdot, self._acceleration))

    @property
    def torque(self) -> str:
        """The inputs `tau` with which the quasi-velocities have the rates `nudot`, by (12)."""
        return self._body("tau", self._system.first_feedback(symbols(self._nudot)))

    @property
    def outputs(self) -> str:
        """The outputs `y` = h (14), with the configuration `place`."""
        return self._body("y", self._law.linearization.h)

    @property
    def forces(self) -> str:
        """The constraint forces `force`, lambda of (8), under the inputs `tau`."""
        return self._body(
            "force", self._system.constraint_forces(self._tau, self._system.acceleration(self._tau))
        )

    def loads(self, share: float, height: float) -> str:
        """Of each contact, three numbers in `load`: the ground's force along and across, and the load, N,
        under the inputs `tau`. `share` of the weight rests on the contacts, with the centre of mass at a
        height (m).
        """
        found = ground(self._system, self._system.acceleration(self._tau), self._tau)
        load = share * GRAVITY * found.mass + height * found.shift
        each = [ca.vertcat(found.force[2 * k : 2 * k + 2], load[k]) for k in range(found.mass.numel())]
        return self._body("load", ca.vertcat(*each))

    def _body(self, array: str, expression: ca.SX) -> str:
        """Return the statements that assign the entries of an expression to those of an array."""
        graph, groups = Graph(), self._groups
        free = {
            q.symbol.element_hash(): (q.symbol, group, q)
            for group, members in groups.items()
            for q in members
        }
        used = [free[symbol.element_hash()] for symbol in ca.symvar(ca.densify(expression))]
        leaves = [graph.leaf(group, q.name) for _, group, q in used]
        roots = [
            row[0]
            for row in from_casadi(
                graph, ca.densify(expression), [s for s, _, _ in used], leaves, self._law.name
            )
        ]
        taken, names = set(OWN), dict[Node, str]()
        for leaf, (_, group, q) in zip(leaves, used, strict=True):
            names[leaf] = f"robot.{q.in_c}" if group is Group.PARAMS else free_name(q.in_c, taken)
        printed = Statements(DOUBLE, names.get, {}, None, taken)
        printed.plan(roots)
        for k, node in enumerate(roots):
            printed.assign(f"{array}[{k}]", node)

        def number(leaf: Leaf) -> int:
            return [q.name for q in groups[leaf.group]].index(leaf.name)

        needed = [
            leaf for leaf in reachable(roots) if isinstance(leaf, Leaf) and leaf.group is not Group.PARAMS
        ]
        places = {Group.STATE: "x", Group.INPUT: "tau", Group.VIRTUAL_INPUT: "nudot", Group.CONFIG: "place"}
        read = [f"const double {names[leaf]} = {places[leaf.group]}[{number(leaf)}];" for leaf in needed]
        return body([*read, *printed.lines])

    @property
    def _groups(self) -> dict[Group, Sequence[Quantity]]:
        mechanism = self._system.mechanism
        own = {
            Group.PARAMS: mechanism.parameters,
            Group.STATE: self._system.state,
            Group.INPUT: mechanism.inputs,
        }
        return {**own, Group.VIRTUAL_INPUT: self._nudot, Group.CONFIG: self._law.config}
