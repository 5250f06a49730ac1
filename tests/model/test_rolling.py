"""model/surfaces.py and model/rolling.py against rigid bodies that roll, made without their formulas."""

import itertools
from fractions import Fraction
from functools import cache

import casadi as ca
import mpmath
import numpy as np
import pytest
from casadi import cos, sin
from noslip.analysis.distributions.distribution import distribution
from noslip.model import Mechanism, ModelError, reduce
from noslip.model.algebra.exact import canonical
from noslip.model.algebra.expression import fold
from noslip.model.rolling.contact import (
    PlanarContact,
    RollingContact,
    mirrors,
    rolling_growth,
    rolls_on,
    vanishes,
)
from noslip.model.rolling.surfaces import (
    Curve,
    Surface,
    backward,
    circle,
    cylinder,
    ellipsoid,
    hollow,
    line,
    plane,
    sphere,
    torus,
)
from scipy.integrate import solve_ivp

# A user's own: oblique coordinates; a sphere by stereographic projection; one as a graph.
saddle = Surface("saddle", lambda u, v: (u + v / 3, v, (u**2 - v**2) / 4 + u * v / 5))


def stereographic(R: ca.SX | float) -> Surface:
    return Surface("ball", lambda u, v: [R * c / (1 + u**2 + v**2) for c in (2 * v, 2 * u, u**2 + v**2 - 1)])


rounded_cone = Surface("cone", lambda u, v: (0.8 * u * cos(v), 0.8 * u * sin(v), -0.6 * u), at={"u": 1})
monge = Surface("cap", lambda u, v: (u, v, ca.sqrt(4 - u**2 - v**2)))
SURFACES = {
    "plane": plane(),
    "sphere": sphere(1.3),
    "cylinder": cylinder(0.7),
    "ellipsoid": ellipsoid(2, 1.5, 1),
    "spheroid": ellipsoid(2, 2, 1),
    "torus": torus(2, 0.5),
    "bowl": hollow(sphere(4)),
    "hollow_ellipsoid": hollow(ellipsoid(9, 8, 7)),
    "saddle": saddle,
    "ball": stereographic(3),
    "cap": monge,
}
# Side of the centre the normal is not on; the others point away from it
OUTWARD = {"bowl": -1, "hollow_ellipsoid": -1}
PAIRS = [
    ("sphere", "plane"),
    ("plane", "sphere"),
    ("sphere", "sphere"),
    ("ellipsoid", "plane"),
    ("ellipsoid", "torus"),
    ("cylinder", "ellipsoid"),
    ("sphere", "bowl"),
    ("hollow_ellipsoid", "spheroid"),
    ("saddle", "ball"),
    ("cap", "saddle"),
]


growth_of = cache(rolling_growth)


@cache
def contact_of(first: str, second: str, spin: bool = True) -> RollingContact:
    return RollingContact(SURFACES[first], SURFACES[second], spin)


def places(count: int, size: int, seed: int) -> np.ndarray:
    """Random coordinates inside every patch above."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, size))


def numeric(surface: Surface, *expressions: ca.SX) -> ca.Function:
    return ca.Function("numeric", [surface.coordinates], [ca.densify(ca.SX(e)) for e in expressions])


def naive_frame(f: ca.SX, u: ca.SX, v: ca.SX, outward: int = 1) -> ca.SX:
    """x along f_u, z along f_u x f_v (or against it), y = z x x; by normalizing."""
    f_u, f_v = ca.jacobian(f, u), ca.jacobian(f, v)
    x, z = f_u / ca.norm_2(f_u), outward * ca.cross(f_u, f_v) / ca.norm_2(ca.cross(f_u, f_v))
    return ca.horzcat(x, ca.cross(z, x), z)


# -- surfaces ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SURFACES)
def test_forms_are_their_definitions(name):
    """f' = [x y] M, K M = [x y]' z', T M = y' x' with a frame made by normalizing,
    differentiated by CasADi."""
    surface = SURFACES[name]
    u, v = ca.vertsplit(surface.coordinates)
    f = surface.point
    frame = naive_frame(f, u, v, surface.outward)
    x, y, z = ca.horzsplit(frame)
    d = [ca.jacobian(column, surface.coordinates) for column in (f, x, z)]
    defined = (frame, frame[:, :2].T @ d[0], frame[:, :2].T @ d[2], y.T @ d[1], z.T @ d[0])
    forms = (surface.frame, surface.M, surface.K @ surface.M, surface.T @ surface.M, ca.SX(1, 2))
    function = numeric(
        surface, *defined, *forms, ca.det(surface.K), surface.gaussian, surface.K - surface.K.T
    )
    for place in places(50, 2, 1):
        *values, det_K, gaussian, skew = (np.array(value) for value in function(place))
        for expected, form in zip(values[:5], values[5:], strict=True):
            assert np.abs(expected - form).max() < 1e-12 * max(1.0, np.abs(expected).max())
        assert abs(det_K - gaussian) < 1e-12 * max(1.0, abs(gaussian)) and np.abs(skew).max() < 1e-12


@pytest.mark.parametrize(
    "name", ["sphere", "ellipsoid", "spheroid", "ball", "cap", "bowl", "hollow_ellipsoid"]
)
def test_normals_point_out_of_the_body(name):
    """Of a convex body about the origin, and into the hollow of a hollow one."""
    surface = SURFACES[name]
    function = numeric(surface, surface.point.T @ surface.frame[:, 2], surface.K)
    for place in places(50, 2, 2):
        side, K = (np.array(value) for value in function(place))
        assert OUTWARD.get(name, 1) * side > 0
        assert np.all(OUTWARD.get(name, 1) * np.linalg.eigvalsh(K) > 0)


def test_forms_of_the_sphere_and_the_torus_as_published():
    """Montana 1988; Murray, Li, Sastry, example 5.6 with the sign of v turned; do Carmo for the torus."""
    R, r = ca.SX.sym("R"), ca.SX.sym("r")
    ball, ring = sphere(R), torus(R, r)
    u, w = ball.coordinates[0], ring.coordinates[0]
    around = R + r * cos(w)
    published = [
        (ball.M, ca.diagcat(R, R * cos(u))),
        (ball.K, ca.diagcat(1 / R, 1 / R)),
        (ball.T, ca.horzcat(0, -sin(u) / (R * cos(u)))),
        (ball.gaussian, 1 / R**2),
        (ring.M, ca.diagcat(r, around)),
        (ring.K, ca.diagcat(1 / r, cos(w) / around)),
        (ring.T, ca.horzcat(0, -sin(w) / around)),
        (ring.gaussian, cos(w) / (r * around)),
    ]
    for form, expected in published:
        assert canonical(form - expected).is_zero()
    assert (
        ball.orthogonal
        and ring.orthogonal
        and not ellipsoid(2, 1.5, 1).orthogonal
        and ellipsoid(R, R, r).orthogonal
    )


def test_flat_surfaces_are_flat():
    R = ca.SX.sym("R")
    cone = Surface("cone", lambda u, v: (u * cos(v), u * sin(v), -R * u), at={"u": 1})
    for surface in (plane(), cylinder(R), cone):
        assert surface.gaussian.is_zero()
    assert vanishes(ca.det(cone.K), ca.sumsqr(cone.K), "K") and not vanishes(cone.K[1, 1], ca.SX(1), "K")


def test_total_curvature_is_two_pi_times_euler():
    """Gauss and Bonnet: the integral of the curvature over a closed surface is 4 pi for an ellipsoid,
    0 for a torus."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    turn = 2 * np.pi * (np.arange(80) + 0.5) / 80
    for surface, u, w, total in (
        (ellipsoid(2, 1.5, 1), nodes * np.pi / 2, weights * np.pi / 2, 4 * np.pi),
        (torus(2, 0.5), turn, np.full(80, np.pi / 40), 0.0),
    ):
        function = numeric(surface, surface.gaussian * ca.det(surface.M))
        value = sum(
            float(function([a, b])) * weight * np.pi / 40
            for a, weight in zip(u, w, strict=True)
            for b in turn
        )
        assert abs(value - total) < 1e-9


# -- rigid bodies that roll ----------------------------------------------------------------------------------


def rigid_bodies(contact: RollingContact) -> ca.Function:
    """(q, q') -> slip at the contact and relative angular velocity, in frame 1,
    from the pose of body 2 alone."""
    q, rates = contact.q, ca.SX.sym("rates", 5)
    f, frames = [], []
    for surface, own in ((contact.first, q[:2]), (contact.second, q[2:4])):
        f.append(ca.vertcat(*surface.position(own[0], own[1])))
        frames.append(naive_frame(f[-1], own[0], own[1], surface.outward))
    x, y, z = ca.horzsplit(frames[0])
    psi = q[4]
    # x_2, y_2, z_2 in body 1
    other = ca.horzcat(cos(psi) * x - sin(psi) * y, -sin(psi) * x - cos(psi) * y, -z)
    rotation = other @ frames[1].T
    origin = f[0] - rotation @ f[1]
    turning = ca.reshape(ca.jtimes(ca.vec(rotation), q, rates), 3, 3)
    moving = ca.jtimes(origin, q, rates)
    omega = ca.inv_skew(turning @ rotation.T)
    slip = moving + turning @ f[1]  # of body 2's material point at the contact; body 1 stands still
    ours = [contact.rotation - rotation, contact.origin - origin, contact.angular_velocity(rates)]
    return ca.Function("bodies", [q, rates], [frames[0].T @ slip, frames[0].T @ omega, *ours])


@pytest.mark.parametrize("pair", PAIRS, ids=" on ".join)
def test_what_montanas_rates_do_to_rigid_bodies(pair):
    """S nu: no slip, and body 1 turns relative to body 2 at omega = nu, in frame 1. So do the basis and A."""
    contact = contact_of(*pair)
    bodies = rigid_bodies(contact)
    maps = ca.Function("maps", [contact.q], [contact.S, contact.basis, contact.A])
    rng = np.random.default_rng(5)
    for place in places(30, 5, 3):
        S, basis, A = (np.array(value) for value in maps(place))
        nu = rng.normal(size=3)
        slip, omega, rotation, origin, ours = (np.array(value).ravel() for value in bodies(place, S @ nu))
        size = max(1.0, np.abs(S).max())
        assert np.abs(slip).max() < 1e-11 * size and np.abs(omega + nu).max() < 1e-11 * size
        assert (
            max(np.abs(rotation).max(), np.abs(origin).max()) < 1e-12
            and np.abs(ours - nu).max() < 1e-11 * size
        )
        assert np.abs(A @ S).max() < 1e-12 * size and np.abs(A @ basis).max() < 1e-12 * size
        # the basis moves the contact along x_1 and y_1 at nu_1 and nu_2 and turns at nu_3
        slip, omega, *_ = (np.array(value).ravel() for value in bodies(place, basis @ nu))
        assert np.abs(slip).max() < 1e-11 and abs(omega[2] + nu[2]) < 1e-11
        # any other motion: A sees exactly what slips
        rates = rng.normal(size=5)
        slip, *_, ours = (np.array(value).ravel() for value in bodies(place, rates))
        psi = place[4]
        turn = np.array([[np.cos(psi), -np.sin(psi)], [-np.sin(psi), -np.cos(psi)]])
        assert abs(slip[2]) < 1e-11 and np.abs(A @ rates - turn @ slip[:2]).max() < 1e-11


@pytest.mark.parametrize("pair", PAIRS, ids=" on ".join)
def test_pure_rolling_has_no_spin(pair):
    contact = contact_of(*pair, spin=False)
    bodies, S = rigid_bodies(contact), ca.Function("S", [contact.q], [contact.S, contact.A])
    for place in places(20, 5, 4):
        value, A = (np.array(v) for v in S(place))
        slip, omega, *_ = (np.array(v).ravel() for v in bodies(place, value @ [0.7, -1.1]))
        size = max(1.0, np.abs(value).max())
        assert np.abs(slip).max() < 1e-11 * size and np.abs(omega + [0.7, -1.1, 0.0]).max() < 1e-11 * size
        rates = np.array([0.3, -0.4, 0.5, 0.6, -0.7])
        assert abs((A @ rates)[2] + np.array(bodies(place, rates)[1]).ravel()[2]) < 1e-11


@pytest.mark.parametrize("spin", [False, True])
@pytest.mark.parametrize("second", ["plane", "sphere", "cylinder", "torus"])
def test_A_S_is_zero_exactly(second, spin):
    a, b, c = (ca.SX.sym(name) for name in "abc")
    body = {"plane": plane(), "sphere": sphere(b), "cylinder": cylinder(b), "torus": torus(b, c)}[second]
    contact = RollingContact(sphere(a), body, spin)
    assert canonical(contact.A @ contact.basis).is_zero() and canonical(contact.A @ contact.S).is_zero()


def rolled(contact: RollingContact, start, rates, duration: float) -> np.ndarray:
    """q at the end, rolling at these quasi-velocities of the basis, functions of q."""
    basis = ca.Function("basis", [contact.q], [contact.basis])
    run = solve_ivp(
        lambda _, q: np.array(basis(q)) @ rates(q),
        (0, duration),
        start,
        rtol=1e-12,
        atol=1e-12,
        method="DOP853",
    )
    return run.y[:, -1]


def turn(axis, angle) -> np.ndarray:
    """Rotation about a unit axis (Rodrigues)."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew


def test_sphere_on_plane_rolls_straight():
    """Its centre moves by d, it turns by |d| / R about the horizontal across d;
    the contact draws a great circle."""
    contact = contact_of("plane", "sphere", spin=False)
    pose = ca.Function("pose", [contact.q], [contact.rotation, contact.origin])
    start, velocity = np.array([0.2, -0.1, 0.3, 0.4, 0.5]), np.array([0.4, -0.2])
    end = rolled(contact, start, lambda q: velocity, 2.0)
    (R0, p0), (R1, p1) = ([np.array(v) for v in pose(q)] for q in (start, end))
    way = np.array([0.8, -0.4, 0.0])
    across = np.cross([0, 0, 1], way) / np.linalg.norm(way)
    assert np.abs(p1 - p0 - way[:, None]).max() < 1e-9 and np.abs(p0.ravel() - [0.2, -0.1, 1.3]).max() < 1e-12
    assert np.abs(R1 @ R0.T - turn(across, np.linalg.norm(way) / 1.3)).max() < 1e-9


def test_sphere_on_sphere_turns_once_more():
    """Along a great circle by angle a on the fixed sphere, the rolling one turns by a (1 + R1 / R2)."""
    R1, R2 = 2.0, 0.8
    contact = RollingContact(sphere(R1), sphere(R2))
    pose = ca.Function("pose", [contact.q], [contact.rotation, contact.origin])
    frame = numeric(contact.first, contact.first.frame)
    start = np.array([0.1, 0.2, -0.3, 0.4, 0.5])
    x, y, z = np.array(frame(start[:2])).T
    axis = np.cross(z, (0.6 * x + 0.8 * y))

    def along(q):
        here = np.array(frame(q[:2]))
        return here[:, :2].T @ np.cross(axis, here[:, 2]) * R1  # unit angular rate about the axis

    end = rolled(contact, start, along, 0.9)
    (rotation, origin), (turned, moved) = ([np.array(v) for v in pose(q)] for q in (start, end))
    assert (
        np.abs(moved - turn(axis, 0.9) @ origin).max() < 1e-9 and abs(np.linalg.norm(moved) - R1 - R2) < 1e-9
    )
    assert np.abs(turned @ rotation.T - turn(axis, 0.9 * (1 + R1 / R2))).max() < 1e-9


# -- the distribution ----------------------------------------------------------------------------------------

IV = mpmath.ctx_iv.MPIntervalContext()
OPERATIONS = {
    **{
        ca.OP_ADD: lambda a, b: a + b,
        ca.OP_SUB: lambda a, b: a - b,
        ca.OP_MUL: lambda a, b: a * b,
        ca.OP_DIV: lambda a, b: a / b,
    },
    **{
        ca.OP_NEG: lambda a: -a,
        ca.OP_SQ: lambda a: a * a,
        ca.OP_TWICE: lambda a: 2 * a,
        ca.OP_INV: lambda a: 1 / a,
    },
    **{ca.OP_SIN: IV.sin, ca.OP_COS: IV.cos, ca.OP_SQRT: IV.sqrt},
}


def bracket(f: ca.SX, g: ca.SX, q: ca.SX) -> ca.SX:
    return ca.jacobian(g, q) @ f - ca.jacobian(f, q) @ g


def levels(fields: list[ca.SX], q: ca.SX, depth: int) -> list[list[ca.SX]]:
    """Vector fields by the number of brackets in them."""
    fields_by_level = [fields]
    for _ in range(depth):
        fields_by_level.append([bracket(f, g, q) for f in fields for g in fields_by_level[-1]])
    return fields_by_level


def surely_independent(columns: list[ca.SX], q: ca.SX, place: list[Fraction]) -> bool:
    """Does interval arithmetic prove that some maximal minor is not zero there?"""
    matrix = ca.horzcat(*columns)
    symbols = ca.vertsplit(q)
    entries = fold(
        matrix,
        symbols,
        lambda k: IV.mpf(place[k].numerator) / place[k].denominator,
        IV.mpf,
        lambda code, args: OPERATIONS[code](*args),
    )
    n, k = matrix.shape
    rows = [[entries[i + n * j] for j in range(k)] for i in range(n)]
    return any(
        0 not in determinant([rows[i] for i in chosen]) for chosen in itertools.combinations(range(n), k)
    )


def determinant(rows):
    if len(rows) == 1:
        return rows[0][0]
    return sum(
        (-1) ** k * row * determinant([[*r[:k], *r[k + 1 :]] for r in rows[1:]])
        for k, row in enumerate(rows[0])
        if row != 0
    ) + IV.mpf(0)


PLACE = [Fraction(1, 3), Fraction(-2, 5), Fraction(3, 7), Fraction(1, 2), Fraction(4, 9)]
FILLING = {
    "sphere on plane": (SURFACES["sphere"], SURFACES["plane"]),
    "spheres": (SURFACES["sphere"], sphere(0.7)),
    "sphere in a bowl": (sphere(1), hollow(sphere(2))),
    "ellipsoid on plane": (SURFACES["ellipsoid"], SURFACES["plane"]),
    "spheroid on plane": (SURFACES["spheroid"], SURFACES["plane"]),
    "congruent ellipsoids": (SURFACES["ellipsoid"], ellipsoid(2, 1.5, 1)),
    "tori": (SURFACES["torus"], torus(2, 0.5)),
    "sphere on cylinder": (sphere(1), cylinder(2)),
}


R1, R2 = ca.SX.sym("R1"), ca.SX.sym("R2")
INVOLUTIVE = {
    "equal spheres": (sphere(R1), sphere(R1)),
    "sphere in two coordinates": (sphere(R1), stereographic(R1)),
    "crossed cylinders": (cylinder(R1), cylinder(R2)),
    "cylinder on plane": (cylinder(R1), plane()),
    "cone on cylinder": (
        Surface("cone", lambda u, v: (u * cos(v), u * sin(v), -R1 * u), at={"u": 1}),
        cylinder(R2),
    ),
}


@cache
def contact_in(case: str, spin: bool = False) -> RollingContact:
    """One contact for all tests of a case: what is found of it once is kept."""
    return RollingContact(*{**FILLING, **INVOLUTIVE}[case], spin)


@pytest.mark.parametrize("case", FILLING)
def test_growth_2_3_5(case):
    """Pure rolling: brackets of the basis fill the space, proved by intervals;
    the structure equations say the same."""
    contact = contact_in(case)
    growth = growth_of(contact)
    assert growth.vector == (2, 3, 5) and growth.holonomic == 0
    first = list(ca.horzsplit(contact.basis))
    second = bracket(*first, contact.q)
    assert surely_independent([*first, second], contact.q, PLACE)
    assert surely_independent(
        [*first, second, *[bracket(f, second, contact.q) for f in first]], contact.q, PLACE
    )


@pytest.mark.parametrize("case", [*FILLING, "equal spheres"])
def test_growth_3_5_with_spin(case):
    contact = (
        contact_in(case, spin=True) if case in FILLING else RollingContact(sphere(1), sphere(1), spin=True)
    )
    growth = growth_of(contact)
    assert growth.vector == (3, 5) and growth.holonomic == 0 and growth.drops_where is None
    fields = list(ca.horzsplit(contact.basis))
    assert surely_independent(
        [*fields, *[bracket(fields[2], f, contact.q) for f in fields[:2]]], contact.q, PLACE
    )


@pytest.mark.parametrize("case", INVOLUTIVE)
def test_same_constant_curvature_is_involutive(case):
    """k = 3, and the bracket is in the span: proved as an identity of rational functions."""
    contact = contact_in(case)
    growth = growth_of(contact)
    assert growth.vector == (2,) and growth.holonomic == 3 and growth.determinant is None
    first, second = ca.horzsplit(contact.basis)
    commutator = bracket(first, second, contact.q)
    left = contact.A @ commutator
    assert canonical(left).is_zero()


@pytest.mark.parametrize("pair", [*(p for p in PAIRS if p[0] != p[1]), ("torus", "torus")], ids=" on ".join)
def test_structure_equations(pair):
    """[e_1, e_2] = -T1 (e_1, e_2)' + (kappa_2 - kappa_1) E, and the determinants of `rolling_growth`,
    at random places."""
    contact = contact_of(*pair)
    e1, e2, E = ca.horzsplit(contact.basis)
    q, T1 = contact.q, contact.forms[0][2]
    b = bracket(e1, e2, q)
    expected = -T1[0] * e1 - T1[1] * e2 - contact.curvature_difference * E
    pure = ca.det(ca.horzcat(e1, e2, b, bracket(e1, b, q), bracket(e2, b, q)))
    spinning = ca.det(ca.horzcat(e1, e2, E, bracket(E, e1, q), bracket(E, e2, q)))
    function = ca.Function("f", [q], [b - expected, pure, spinning])
    claimed = []
    for spin in (False, True):
        same = contact_of(*pair, spin)
        claimed.append(ca.Function("g", [same.q], [growth_of(same).determinant]))
    for place in places(30, 5, 6):
        rest, *determinants = (np.array(value) for value in function(place))
        assert np.abs(rest).max() < 1e-10
        for value, claim in zip(determinants, claimed, strict=True):
            assert abs(value - float(claim(place))) < 1e-9 * max(1.0, abs(value))


@pytest.mark.parametrize("case", [*FILLING, *INVOLUTIVE])
def test_brackets_of_the_exact_analysis_agree(case):
    """`distribution` forms the brackets and knows nothing of curvature;
    two ellipsoids of three axes are too much for it."""
    for spin in (False, True):
        contact = contact_in(case, spin)
        if case != "congruent ellipsoids":
            assert distribution(contact.kinematics()).growth == growth_of(contact).vector


def test_where_the_growth_drops():
    contact = RollingContact(sphere(R1), sphere(R2))
    growth = rolling_growth(contact)
    assert canonical(growth.drops_where - (1 / R1**2 - 1 / R2**2)).is_zero() and not growth.special
    assert rolling_growth(RollingContact(sphere(R1), plane())).drops_where is not None  # R1 at infinity only
    assert rolling_growth(RollingContact(sphere(1), plane())).drops_where is None


def iterated(contact: RollingContact, place, depth: int) -> int:
    """Rank of all brackets up to this depth at one place, in floating point."""
    brackets = levels(list(ca.horzsplit(contact.basis)), contact.q, depth)
    value = np.array(ca.Function("f", [contact.q], [ca.horzcat(*itertools.chain(*brackets))])(place))
    value = value / np.maximum(1.0, np.linalg.norm(value, axis=0))
    return int(np.linalg.matrix_rank(value, tol=1e-8))


def test_congruent_ellipsoids_have_one_special_orbit():
    """k = 0; the mirror configurations are kept by rolling, with dimension 2; elsewhere K1 = K2 is left."""
    contact = contact_in("congruent ellipsoids")
    growth = growth_of(contact)
    assert growth.holonomic == 0 and growth.vector == (2, 3, 5)
    assert growth.special == ("u2 = u1, v2 = -v1, psi = 0", "u2 = -u1, v2 = v1, psi = pi")
    mirror = [0.3, 0.5, 0.3, -0.5, 0.0]
    twisted = [0.3, 0.5, 0.3, -0.5, 0.4]  # K1 = K2, but not the mirror image
    assert iterated(contact, [0.3, 0.5, -0.3, 0.5, np.pi], 3) == 2
    assert iterated(contact, mirror, 3) == 2 and iterated(contact, twisted, 3) == 5
    rng = np.random.default_rng(8)
    push = rng.normal(size=(2, 4))
    end = rolled(contact, mirror, lambda q: push @ np.sin(q[:2].sum() * np.arange(1, 5)), 1.0)
    assert (
        np.abs(end - [end[0], end[1], end[0], -end[1], 0.0]).max() < 1e-8 and np.abs(end - mirror).max() > 0.1
    )
    end = rolled(contact, twisted, lambda q: push @ np.sin(q[:2].sum() * np.arange(1, 5)), 1.0)
    difference = ca.Function("D", [contact.q], [contact.curvature_difference])
    assert abs(float(difference(end))) > 1e-3


def test_surfaces_of_revolution_have_a_family_of_special_orbits():
    contact = contact_in("tori")
    assert growth_of(contact).special[0] == "u2 = u1, v2 = -v1 + const, psi = 0"
    assert (
        iterated(contact, [0.3, 0.5, 0.3, 0.9, 0.0], 3) == 2
        and iterated(contact, [0.3, 0.5, 0.3, 0.9, 0.2], 3) == 5
    )
    assert not mirrors(RollingContact(torus(2, 0.5), torus(3, 0.5))) and not mirrors(
        RollingContact(sphere(1), plane())
    )
    inside = RollingContact(SURFACES["ellipsoid"], hollow(ellipsoid(2, 1.5, 1)))
    assert "u2 = u1, v2 = v1, psi = 0" in rolling_growth(inside).special


# -- what is refused or marked -------------------------------------------------------------------------------


def test_contact_along_a_line_is_marked_and_refused():
    R = ca.SX.sym("R")
    for pair in ((cylinder(R), plane()), (plane(), plane()), (sphere(R), hollow(sphere(R)))):
        contact = RollingContact(*pair)
        assert "touch along a line" in contact.formal
        with pytest.raises(ModelError, match="formally; use the basis"):
            _ = contact.S
    robot = Mechanism("roller")
    q = [robot.coordinate(name, "1") for name in ("a", "b", "c", "d", "e")]
    with pytest.raises(
        ModelError, match="roller: drum: cylinder on plane: the relative curvature is singular everywhere"
    ):
        rolls_on(robot, "drum", RollingContact(cylinder(1), plane()), q)
    rolls_on(robot, "drum", RollingContact(cylinder(1), plane()), q, formal=True)
    assert robot.A.shape == (3, 5)
    crossed = RollingContact(cylinder(1), cylinder(2))
    assert not crossed.formal
    crossed.refuse([0.1, 0.2, 0.3, 0.4, 1.0], {})
    with pytest.raises(ModelError, match="touch along a line at u1"):
        crossed.refuse([0.1, 0.2, 0.3, 0.4, 0.0], {})
    with pytest.raises(ModelError, match="overlap"):
        RollingContact(torus(2, 0.5), plane()).refuse([3.0, 0.2, 0.3, 0.4, 0.0], {})
    with pytest.raises(ModelError, match="overlap"):
        RollingContact(sphere(2), hollow(sphere(R))).refuse([0.1, 0.2, 0.3, 0.4, 0.0], {"R": 1.0})


@pytest.mark.parametrize("u", [np.pi / 2, -np.pi / 2, 2.0, np.nan])
def test_poles_are_refused(u):
    R = ca.SX.sym("R")
    for surface in (sphere(R), ellipsoid(2 * R, 3 * R, R)):
        with pytest.raises(ModelError, match=r"the poles, u = -pi/2 and u = pi/2"):
            surface.refuse([u, 0.3], {"R": 0.2})
        surface.refuse([1.57, 0.3], {"R": 0.2})
        with pytest.raises(ModelError, match="body|poles"):
            RollingContact(plane(), surface).refuse([0, 0, u, 0.3, 0], {"R": 0.2})


def test_apex_of_a_cone_and_the_ends_of_a_cap():
    cone = Surface("cone", lambda u, v: (u * cos(v), u * sin(v), -u), at={"u": 1}, singular="the apex")
    with pytest.raises(ModelError, match="the apex"):
        cone.refuse([0.0, 0.3], {})
    with pytest.raises(ModelError, match="cap: .* must be positive"):
        monge.refuse([2.0, 0.1], {})
    with pytest.raises(ModelError, match="no value for R"):
        sphere(ca.SX.sym("R")).refuse([0, 0], {})


BAD_SURFACES = [
    (lambda: Surface("fold", lambda u, v: (u, v, ca.fabs(u))), "not smooth, its position uses fabs"),
    (lambda: Surface("step", lambda u, v: (u, v, ca.if_else(u > 0, u, 0))), "not smooth"),
    (lambda: Surface("flat", lambda u, v: (u, v)), "3 components, it has 2"),
    (lambda: Surface("thread", lambda u, v: (u, 2 * u, 0)), r"zero everywhere: not a surface"),
    (
        lambda: Surface("thin", lambda u, v: (u + v, 2 * (u + v), sin(u + v))),
        r"zero everywhere: not a surface",
    ),
    (
        lambda: Surface("colatitude", lambda u, v: (sin(u) * cos(v), sin(u) * sin(v), cos(u))),
        "name a regular place with at=",
    ),
    (lambda: Surface("typo", lambda u, v: (u, v, 0), at={"w": 1}), "unknown name 'w'"),
    (lambda: Surface("taken", lambda u, v: (u, v, ca.SX.sym("u"))), "'u' is a coordinate"),
    (lambda: Surface("side", lambda u, v: (u, v, 0), outward=0), "outward must be 1 or -1"),
    (lambda: Surface("text", lambda u, v: "u"), "is not an expression"),
    (lambda: Surface("arity", lambda u: (u, u, u)), r"function of \(u, v\)"),
    (lambda: Surface("entry", lambda u, v: (u, v, "w")), "is not an expression"),
    (lambda: sphere(0), "radius R = 0 must be positive"),
    (lambda: cylinder(-1), "must be positive"),
    (lambda: sphere(float("nan")), "must be positive"),
    (lambda: ellipsoid(1, 0, 1), "half axis b"),
    (lambda: torus(1, 2), "R - r"),
    (lambda: sphere("R"), "is not an expression"),
]


@pytest.mark.parametrize("make, message", BAD_SURFACES)
def test_bad_surfaces_are_refused(make, message):
    with pytest.raises(ModelError, match=message):
        surface = make()
        _ = surface.parameters, surface.M, surface.frame, surface.K


def test_names_cannot_be_mixed_up():
    with pytest.raises(ModelError, match="'R' is used twice"):
        _ = RollingContact(sphere(ca.SX.sym("R")), sphere(ca.SX.sym("R"))).parameters
    with pytest.raises(ModelError, match="'psi' is used twice"):
        _ = RollingContact(sphere(ca.SX.sym("psi")), plane()).parameters


# -- curves --------------------------------------------------------------------------------------------------


def test_planar_rolling_is_holonomic_and_right():
    """m1 u1' = m2 u2' from the bodies' motion: one turns on the other so that tangents agree,
    and nothing slips."""
    oval = Curve("oval", lambda u: (2 * cos(u), sin(u)))
    for first, second in (
        (oval, line()),
        (circle(0.4), backward(circle(0.7))),
        (oval, backward(oval)),
        (circle(1), circle(3)),
    ):
        contact = PlanarContact(first, second)
        assert (
            canonical(contact.A @ contact.basis).is_zero()
            and contact.basis.shape == (2, 1)
            and not contact.formal
        )
        q, rates = contact.q, ca.SX.sym("rates", 2)
        f = [ca.vertcat(*body.position(q[k])) for k, body in enumerate((first, second))]
        d = [ca.jacobian(f[k], q[k]) for k in (0, 1)]
        t = [each / ca.norm_2(each) for each in d]
        c, s = t[0].T @ t[1], t[1][0] * t[0][1] - t[1][1] * t[0][0]
        rotation = ca.blockcat([[c, -s], [s, c]])  # body 2 in body 1: t_2 goes to t_1
        origin = f[0] - rotation @ f[1]
        turning = ca.reshape(ca.jtimes(ca.vec(rotation), q, rates), 2, 2)
        slip = t[0].T @ (ca.jtimes(origin, q, rates) + turning @ f[1])
        function = ca.Function("f", [q, rates], [slip - contact.A @ rates, contact.relative_curvature])
        for place in places(20, 2, 9):
            rest, curvature = function(place, [0.7, -0.3])
            assert abs(float(rest)) < 1e-12 and float(curvature) > 0
            contact.refuse(place, {})
        growth = rolling_growth(contact)
        assert growth.vector == (1,) == distribution(contact.kinematics()).growth and growth.holonomic == 1


def test_planar_degenerate():
    with pytest.raises(ModelError, match="name a regular place"):
        _ = Curve("cusp", lambda u: (u**2, u**3)).m
    cusp = Curve("cusp", lambda u: (u**2, u**3), at={"u": 1.0})
    with pytest.raises(ModelError, match="must be positive"):
        cusp.refuse([0.0], {})
    assert PlanarContact(line(), line()).formal
    with pytest.raises(ModelError, match="overlap"):
        PlanarContact(circle(1), circle(0.5)).refuse([0.0, 0.0], {})


# -- as constraints of a mechanism ---------------------------------------------------------------------------


def ball_on_plane(spin: bool) -> Mechanism:
    """A ball on the ground, pushed by two torques (and one about the vertical)."""
    robot = Mechanism("ball_plate")
    R, m = robot.parameter("R", 0.1, "m"), robot.parameter("m", 2.0, "kg")
    names = {"x": "m", "y": "m", "latitude": "rad", "longitude": "rad", "psi": "rad"}
    q = ca.vertcat(*[robot.coordinate(name, unit) for name, unit in names.items()])
    contact = RollingContact(plane(), sphere(R), spin)
    rolls_on(robot, "ball", contact, q)
    velocity = robot.rate(ca.substitute(contact.origin, contact.q, q))
    # Of the ball: body 2 relative to body 1
    omega = -ca.substitute(contact.angular_velocity(robot.qdot), contact.q, q)
    robot.kinetic_energy(m * ca.sumsqr(velocity) / 2 + 2 * m * R**2 / 5 * ca.sumsqr(omega) / 2)
    for k, axis in enumerate("xyz"[: 3 if spin else 2]):
        robot.input(f"torque_{axis}", "N m", on=omega[k])
        robot.quasi_velocity(f"omega_{axis}", "rad/s", omega[k])
    return robot


@pytest.mark.parametrize("spin", [False, True])
def test_ball_on_plane_as_a_mechanism(spin):
    """S'MS is 7/5 m R^2 (2/5 about the vertical), no bias, and the ball's point of contact moves at omega x
    R."""
    robot = ball_on_plane(spin)
    assert robot.constraint_names[0] == "ball: no slip along x_2" and robot.A.shape == (2 if spin else 3, 5)
    assert distribution(robot).growth == ((3, 5) if spin else (2, 3, 5))
    system = reduce(robot)
    values = ca.Function("f", [robot.q, system.nu, robot.p], [system.Mbar, system.bias, system.S])
    for place in places(20, 5, 10):
        Mbar, bias, S = (np.array(v) for v in values(place, np.ones(system.dof), [0.1, 2.0]))
        expected = 2.0 * 0.1**2 * np.diag([1.4, 1.4, 0.4][: system.dof])
        assert np.abs(Mbar - expected).max() < 1e-12 and np.abs(bias).max() < 1e-12
        assert np.abs(S[:2, :2] - [[0, 0.1], [-0.1, 0]]).max() < 1e-12


def test_sizes_that_overlap_are_refused_at_the_defaults():
    robot = Mechanism("ball_in_bowl")
    R, r = robot.parameter("R", 0.1, "m"), robot.parameter("r", 0.2, "m")
    q = [robot.coordinate(name, "1") for name in "abcde"]
    with pytest.raises(
        ModelError,
        match="ball_in_bowl: ball: trace of the relative curvature: .* negative where they overlap",
    ):
        rolls_on(robot, "ball", RollingContact(sphere(r), hollow(sphere(R))), q)
    with pytest.raises(ModelError, match="torus: R - r must be positive"):
        rolls_on(robot, "ring", RollingContact(torus(R, r), plane()), q)
    rolls_on(robot, "ball", RollingContact(sphere(R), hollow(sphere(r))), q)
    assert robot.A.shape == (3, 5)


@pytest.mark.nightly
def test_numbers_that_are_rounded_never_decide():
    """0.1 is rounded: two ways to write one sphere are not said to be two spheres;
    A and S keep the number as it is written."""
    for pair in (
        (sphere(0.1), sphere(0.1)),
        (sphere(0.1), stereographic(0.1)),
        (cylinder(0.3), rounded_cone),
    ):
        assert distribution(RollingContact(*pair).kinematics()).growth == (2,)
    for radius in (0.1, 0.3 - 0.2):  # the difference is read as the decimal that it is but for its rounding
        assert rolling_growth(RollingContact(sphere(0.1), sphere(radius))).vector == (2,)
    with pytest.raises(ModelError, match="zero to rounding"):
        rolling_growth(RollingContact(sphere(0.1), sphere(0.1 + 1e-14)))


def test_rolls_on_takes_expressions_and_refuses_a_wrong_number():
    """A wheel on a line, the contact at -theta on its outline: x' = -R theta'."""
    robot = Mechanism("wheel")
    R = robot.parameter("R", 0.1, "m")
    x, theta = robot.coordinate("x", "m"), robot.coordinate("theta", "rad")
    with pytest.raises(ModelError, match=r"q must be \(u1, u2\); it has 3 entries"):
        rolls_on(robot, "wheel", PlanarContact(circle(R), line()), [theta, x, x])
    with pytest.raises(ModelError, match="is not an expression"):
        rolls_on(robot, "wheel", PlanarContact(circle(R), line()), ["theta", x])
    rolls_on(robot, "wheel", PlanarContact(circle(R), line()), [-theta - ca.pi / 2, x])
    assert canonical(robot.A + ca.horzcat(1, R)).is_zero()
