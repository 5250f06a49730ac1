"""Robots that are not shipped, as descriptions of random_robots.py, by which their equations are derived
without noslip too.

Bodies are at places and headings in the plane; a wheel is a place at a heading across which it does not move.
Outputs that do not make Phi regular by themselves are added by `with_outputs`.
"""

import casadi as ca
from noslip.model import Mechanism
from noslip.tests.random_robots import RandomRobot, Tree, Velocity, decimal, in_casadi, mechanism

ONE = decimal("1")
Place = tuple[Tree, Tree]


def q(k: int) -> Tree:
    return Tree("q", (k,))


def p(k: int) -> Tree:
    return Tree("p", (k,))


def cos(a: Tree) -> Tree:
    return Tree("cos", (a,))


def sin(a: Tree) -> Tree:
    return Tree("sin", (a,))


def ahead(place: Place, heading: Tree, distance: Tree) -> Place:
    """The place so far ahead."""
    return place[0] + distance * cos(heading), place[1] + distance * sin(heading)


def behind(place: Place, heading: Tree, distance: Tree) -> Place:
    return place[0] - distance * cos(heading), place[1] - distance * sin(heading)


def along(place: Place, heading: Tree) -> Velocity:
    return Velocity(terms=((cos(heading), place[0]), (sin(heading), place[1])))


def across(place: Place, heading: Tree) -> Velocity:
    return Velocity(terms=((cos(heading), place[1]), (decimal("-1") * sin(heading), place[0])))


def rolling(place: Place, heading: Tree, radius: Tree, wheel: Tree) -> Velocity:
    """What is zero if a wheel of this radius, turned by `wheel`, rolls there."""
    return Velocity(terms=(*along(place, heading).terms, (decimal("-1") * radius, wheel)))


def body(mass: str, inertia: str, place: Place, heading: Tree) -> list[tuple[Tree, Tree]]:
    """Weights, and the functions of q of whose rates they weigh the squares."""
    return [(decimal(mass), place[0]), (decimal(mass), place[1]), (decimal(inertia), heading)]


def rate(*functions: Tree) -> tuple[Velocity, ...]:
    return tuple(Velocity(f) for f in functions)


def robot(
    name,
    coordinates,
    parameters,
    bodies,
    constraints,
    inputs,
    quasi,
    outputs=(),
    vehicle=None,
    potential=None,
):
    """The description of one robot; `outputs` are functions of q, all of relative degree 2, or velocities."""
    weights, places = zip(*bodies, strict=True)
    rows = tuple((1 if isinstance(row, Velocity) else 2, row) for row in outputs)
    weight = potential or decimal("0") * q(0)
    quasi = quasi or inputs
    parts = weights, places, weight, (), tuple(constraints), tuple(inputs), tuple(quasi), rows
    return RandomRobot(0, len(coordinates), tuple(parameters), *parts, name, tuple(coordinates), vehicle)


AT, PHI = (q(0), q(1)), q(2)


def off_axle() -> RandomRobot:
    """A unicycle with a trailer, hitched p_0 behind its axle;
    the heading of the trailer is a coordinate called psi."""
    psi, trailer = q(3), behind(behind(AT, PHI, p(0)), q(3), p(1))
    bodies = [*body("3", "0.4", AT, PHI), *body("2", "0.3", ahead(trailer, psi, decimal("0.1")), psi)]
    driven = (along(AT, PHI), *rate(PHI))
    constraints = across(AT, PHI), across(trailer, psi)
    return robot(
        "off_axle", ("x", "y", "phi", "psi"), ("0.3", "0.8"), bodies, constraints, driven, (), (), (*AT, PHI)
    )


def trailer_of_off_axle() -> Place:
    return behind(behind(AT, PHI, p(0)), q(3), p(1))


def two_steered() -> RandomRobot:
    """Both wheels of a bicycle are steered, s and chi, and the front wheel is driven."""
    front, rear = ahead(AT, PHI, p(0)), behind(AT, PHI, p(1))
    s, chi = PHI + q(3), PHI + q(4)
    bodies = [*body("5", "0.6", AT, PHI), *body("1", "0.05", front, s), *body("1", "0.05", rear, chi)]
    driven = along(front, s), *rate(q(3), q(4))
    constraints = across(front, s), across(rear, chi)
    return robot(
        "two_steered",
        ("x", "y", "phi", "s", "chi"),
        ("0.5", "0.7"),
        bodies,
        constraints,
        driven,
        (),
        (),
        (*AT, PHI),
    )


def loader() -> RandomRobot:
    """An articulated loader, driven at its rear wheels and bent at its joint;
    gamma is that of the front body from the rear."""
    psi = PHI - q(3)
    joint = behind(AT, PHI, p(0))
    rear = behind(joint, psi, p(1))
    bodies = [
        *body("5", "6", ahead(AT, PHI, decimal("0.2")), PHI),
        *body("7", "9", ahead(rear, psi, decimal("0.3")), psi),
    ]
    bodies += [(decimal("0.8"), q(4))]
    constraints = across(AT, PHI), across(rear, psi), rolling(rear, psi, decimal("0.7"), q(4))
    names = ("x", "y", "phi", "gamma", "theta")
    return robot("loader", names, ("1.6", "1.3"), bodies, constraints, rate(q(4), q(3)), (), (), (*AT, PHI))


def rear_of_loader() -> Place:
    return behind(behind(AT, PHI, p(0)), PHI - q(3), p(1))


def trident() -> RandomRobot:
    """A body with three legs, each with a wheel at its end; the legs are turned,
    the quasi-velocities are the body's."""
    bodies, constraints = body("4", "0.5", AT, PHI), []
    for k, corner in enumerate(("0", "2.0943951023931953", "-2.0943951023931953")):
        leg = PHI + decimal(corner) + q(3 + k)
        wheel = ahead(ahead(AT, PHI + decimal(corner), p(0)), leg, p(1))
        bodies += body("0.5", "0.02", wheel, leg)
        constraints.append(across(wheel, leg))
    names = ("x", "y", "phi", "leg_1", "leg_2", "leg_3")
    driven, quasi = rate(q(3), q(4), q(5)), rate(*AT, PHI)
    return robot("trident", names, ("0.4", "0.6"), bodies, constraints, driven, quasi, (*AT, PHI), (*AT, PHI))


def pendulum_disk() -> RandomRobot:
    """An upright disk with a pendulum in its plane, driven by the torque between the two,
    and turned about the vertical."""
    roll, swing = q(3), q(4)
    hanging = p(1) * sin(swing)  # ahead of the centre, along the heading
    bob = ahead(AT, PHI, hanging)
    bodies = [
        *body("2", "0.1", AT, PHI),
        (decimal("0.05"), roll),
        (decimal("1"), bob[0]),
        (decimal("1"), bob[1]),
    ]
    bodies += [(decimal("1"), p(1) * cos(swing))]
    constraints = across(AT, PHI), rolling(AT, PHI, p(0), roll)
    weight = decimal("-9.81") * p(1) * cos(swing)
    quasi = rate(roll, PHI, swing)
    names, driven = ("x", "y", "phi", "roll", "V"), rate(roll + swing, PHI)
    return robot(
        "pendulum_disk", names, ("0.3", "0.2"), bodies, constraints, driven, quasi, (roll, PHI), None, weight
    )


def rotor() -> RandomRobot:
    """A unicycle pushed along its heading and turned by a rotor on it."""
    bodies = [*body("3", "0.4", AT, PHI), (p(0), PHI + q(3))]
    driven, quasi = (along(AT, PHI), *rate(q(3))), (along(AT, PHI), *rate(PHI, q(3)))
    return robot(
        "rotor",
        ("x", "y", "phi", "spin"),
        ("0.1",),
        bodies,
        (across(AT, PHI),),
        driven,
        quasi,
        (),
        (*AT, PHI),
    )


def castor() -> RandomRobot:
    """Two driven wheels and a castor p_0 ahead of their axle whose wheel trails by p_1;
    its angle to the body is a coordinate."""
    wheel_at = castor_wheel()
    bodies = [
        *body("6", "0.8", ahead(AT, PHI, decimal("0.1")), PHI),
        *body("0.3", "0.01", wheel_at, PHI + q(3)),
    ]
    b, r = decimal("0.3"), decimal("0.1")
    sides = [Velocity(terms=(*along(AT, PHI).terms, (b, PHI), (decimal("-0.1"), q(4))))]
    sides += [Velocity(terms=(*along(AT, PHI).terms, (decimal("-0.3"), PHI), (decimal("-0.1"), q(5))))]
    bodies += [(r * r, q(4)), (r * r, q(5))]
    constraints = across(AT, PHI), across(wheel_at, PHI + q(3)), *sides
    names = ("x", "y", "phi", "n_x", "right", "left")
    return robot("castor", names, ("0.5", "0.15"), bodies, constraints, rate(q(4), q(5)), (), (), (*AT, PHI))


def castor_wheel() -> Place:
    return behind(ahead(AT, PHI, p(0)), PHI + q(3), p(1))


def with_output(described: RandomRobot, name: str, *rows: Tree) -> Mechanism:
    """The mechanism with outputs that are functions of q."""
    made = mechanism(described)
    symbols = ca.vertsplit(made.q), [each.symbol for each in made.parameters]
    made.output(
        name,
        "outputs of this test",
        [(f"y_{k}", "m", in_casadi(row, *symbols)) for k, row in enumerate(rows)],
    )
    return made


DESCRIBED = (off_axle, two_steered, loader, trident, pendulum_disk, rotor, castor)
