"""The shipped robots again, from their textbook description: bodies, frames and points in SymPy, Kane's or
Lagrange's method.

Nothing here looks at model/robots. Symbols have the same names, so that numbers can be given by name.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp
from sympy.physics.mechanics import (
    KanesMethod,
    LagrangesMethod,
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

t = dynamicsymbols._t


@dataclass(frozen=True, eq=False)
class Motion:
    """Functions of (q, qdot, tau, parameters): `system` [matrix, right side] for qddot and what else is
    unknown, `slip` the velocities that must vanish, the energy, and the power of all loads that are no
    weight.
    """

    coordinates: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    system: Callable
    slip: Callable
    energy: Callable
    power: Callable

    def acceleration(
        self, q: Sequence[float], qdot: Sequence[float], tau: Sequence[float], p: Sequence[float]
    ) -> np.ndarray:
        """(n,), from n equations of motion with m multipliers,
        or n-m of Kane's with the constraints differentiated."""
        system = np.array(self.system(q, qdot, tau, p), float)
        return np.linalg.solve(system[:, :-1], system[:, -1])[: len(q)]


class Description:
    """What the methods share: coordinates q with their rates u, inputs, parameters, bodies,
    loads and vanishing velocities."""

    def __init__(self, coordinates: str, inputs: str, parameters: str):
        self.q = list(dynamicsymbols(coordinates))
        self.rates = [q.diff(t) for q in self.q]
        self.inputs, self.parameters = list(sp.symbols(inputs)), list(sp.symbols(parameters))
        self.N, self.O = ReferenceFrame("N"), Point("O")
        self.O.set_vel(self.N, 0)
        self.bodies: list[RigidBody | Particle] = []
        self.loads: list[tuple] = []
        self.vanishing: list[sp.Expr] = []
        self.potential = self.turning = sp.Integer(0)  # energies of what has no body

    def point(self, name: str, origin: Point, place) -> Point:
        """Some way from another point; its velocity by differentiating its place."""
        other = origin.locatenew(name, place)
        other.set_vel(self.N, other.pos_from(self.O).dt(self.N))
        return other

    def body(self, name: str, centre: Point, frame: ReferenceFrame, mass, about: tuple) -> None:
        """With principal moments of inertia about the axes of its frame."""
        self.bodies.append(RigidBody(name, centre, frame, mass, (inertia(frame, *about), centre)))

    def contact(self, velocity, *directions) -> None:
        """The velocity has no component in these directions."""
        self.vanishing += [velocity.dot(direction) for direction in directions]

    def kane(self) -> Motion:
        """By Kane's method, all rates as speeds, as many of them dependent as velocities vanish."""
        u = list(dynamicsymbols(" ".join(f"u_{k}" for k in range(len(self.q)))))
        speeds = dict(zip(self.rates, u, strict=True))
        vanishing = [velocity.xreplace(speeds) for velocity in self.vanishing]
        m = len(vanishing)
        kane = KanesMethod(
            self.N,
            q_ind=self.q,
            u_ind=u[m:],
            kd_eqs=[rate - speed for rate, speed in speeds.items()],
            u_dependent=u[:m],
            velocity_constraints=vanishing,
        )
        kane.kanes_equations(self.bodies, [(place, load.subs(speeds)) for place, load in self.loads])
        order = [*u[m:], *u[:m]]
        permuted = kane.mass_matrix * sp.Matrix(len(u), len(u), lambda i, j: int(order[i] == u[j]))
        back = {speed: rate for rate, speed in speeds.items()}
        return self._motion(permuted.xreplace(back), kane.forcing.xreplace(back))

    def lagrange(self, holonomic: Sequence[sp.Expr] = ()) -> Motion:
        """By Lagrange's equations with multipliers."""
        lagrangian = self._kinetic() - self.potential
        constraints = {"nonhol_coneqs": self.vanishing} if self.vanishing else {}
        constraints |= {"hol_coneqs": list(holonomic)} if holonomic else {}
        method = LagrangesMethod(lagrangian, self.q, forcelist=self.loads, frame=self.N, **constraints)
        method.form_lagranges_equations()
        n = len(self.q)
        self.vanishing += [equation.diff(t) for equation in holonomic]
        return self._motion(method.mass_matrix_full[n:, n:], method.forcing_full[n:, :])

    def _kinetic(self) -> sp.Expr:
        return sum((body.kinetic_energy(self.N) for body in self.bodies), start=self.turning)

    def _motion(self, matrix: sp.Matrix, right: sp.Matrix) -> Motion:
        rates = [sp.Symbol(f"rate_{k}") for k in range(len(self.q))]
        places = [sp.Symbol(f"place_{k}") for k in range(len(self.q))]
        plain = {**dict(zip(self.rates, rates, strict=True)), **dict(zip(self.q, places, strict=True))}
        arguments = [places, rates, self.inputs, self.parameters]

        def function(expression) -> Callable:
            return sp.lambdify(arguments, sp.sympify(expression).xreplace(plain), "numpy", cse=True)

        power = sum(
            (place.ang_vel_in(self.N) if isinstance(place, ReferenceFrame) else place.vel(self.N)).dot(load)
            for place, load in self.loads
        )
        names = (
            tuple(str(q.func) for q in self.q),
            tuple(map(str, self.inputs)),
            tuple(map(str, self.parameters)),
        )
        energy = self._kinetic() + self.potential
        both, slip = function(matrix.row_join(right)), function(sp.Matrix(self.vanishing))
        return Motion(*names, both, slip, function(energy), function(power))


def knife_edge() -> Motion:
    d = Description("x y phi", "force torque", "m I")
    (x, y, phi), (force, torque), (m, I) = d.q, d.inputs, d.parameters  # noqa: E741
    N, B = d.N, d.N.orientnew("B", "Axis", (phi, d.N.z))
    centre = d.point("C", d.O, x * N.x + y * N.y)
    d.body("blade", centre, B, m, (0, 0, I))
    d.contact(centre.vel(N), B.y)
    d.loads = [(centre, force * B.x), (B, torque * N.z)]
    return d.lagrange()


def rolling_disk() -> Motion:
    d = Description("x y phi theta", "tau_theta tau_phi", "m R I J")
    (x, y, phi, theta), (tau_theta, tau_phi), (m, R, I, J) = d.q, d.inputs, d.parameters  # noqa: E741
    N, B = d.N, d.N.orientnew("B", "Axis", (phi, d.N.z))
    D = B.orientnew("D", "Axis", (theta, B.y))
    centre = d.point("C", d.O, x * N.x + y * N.y + R * N.z)
    d.body("disk", centre, D, m, (J, I, J))
    d.contact(centre.vel(N) + D.ang_vel_in(N).cross(-R * N.z), B.x, B.y)
    d.loads = [(D, tau_theta * B.y + tau_phi * N.z)]
    return d.kane()


def _steered(driven_in_front: bool, linked: bool = False) -> Motion:
    """With a rear axle that is `linked`, a body of its own turns by -k delta with the driven wheels on it."""
    d = Description("x y phi delta theta", "tau_d tau_s", "m l c r I_c I_s I_w" + " k I_r" * linked)
    (x, y, phi, delta, theta), (tau_d, tau_s), (m, l, c, r, I_c, I_s, I_w, *of_rear) = (  # noqa: E741
        d.q,
        d.inputs,
        d.parameters,
    )
    N, B = d.N, d.N.orientnew("B", "Axis", (phi, d.N.z))
    F = B.orientnew("F", "Axis", (delta, B.z))
    H = B.orientnew("H", "Axis", (-of_rear[0] * delta, B.z)) if linked else B
    carrier = F if driven_in_front else H
    W = carrier.orientnew("W", "Axis", (theta, carrier.y))
    rear = d.point("R", d.O, x * N.x + y * N.y)
    front, centre = d.point("F", rear, l * B.x), d.point("C", rear, c * B.x)
    d.body("body", centre, B, m, (0, 0, I_c))
    d.body("fork", front, F, 0, (0, 0, I_s))
    if linked:
        d.body("rear axle", rear, H, 0, (0, 0, of_rear[1]))
    d.body("wheel", front if driven_in_front else rear, W, 0, (0, I_w, 0))
    axle = front if driven_in_front else rear
    # The constraints first that can be solved for x, y, theta at any speed of phi and delta.
    d.contact(rear.vel(N), H.y)
    d.contact(front.vel(N), F.y)
    d.contact(axle.vel(N) + W.ang_vel_in(N).cross(-r * N.z), carrier.x)
    d.loads = [(W, tau_d * carrier.y), (carrier, -tau_d * carrier.y), (F, tau_s * N.z), (B, -tau_s * N.z)]
    return d.lagrange()


def ball_plate() -> Motion:
    """The ball turns by z-y-z angles from upside down; its point at latitude u, longitude -v is lowest,
    psi turns it there."""
    d = Description("u v x y psi x_p y_p", "force_x force_y", "m R I m_p")
    (u, v, x, y, psi, x_p, y_p), (force_x, force_y) = d.q, d.inputs
    m, R, I, m_p = d.parameters  # noqa: E741
    N, ball = d.N, d.N
    for angle, axis in ((sp.pi, "x"), (psi, "z"), (sp.pi / 2 - u, "y"), (sp.pi + v, "z")):
        ball = ball.orientnew(f"{ball.name}{axis}", "Axis", (angle, getattr(ball, axis)))
    middle, plate = (
        d.point("C", d.O, x * N.x + y * N.y + R * N.z),
        d.point("P", d.O, x_p * N.x + y_p * N.y + 2 * R * N.z),
    )
    omega = ball.ang_vel_in(N).express(N)
    d.bodies = [Particle("ball", middle, m), Particle("plate", plate, m_p)]
    d.turning = I * omega.dot(omega) / 2
    d.contact(middle.vel(N) + omega.cross(-R * N.z), N.x, N.y)
    d.contact(omega, N.z)
    d.contact(middle.vel(N) + omega.cross(R * N.z) - plate.vel(N), N.x, N.y)
    d.loads = [(plate, force_x * N.x + force_y * N.y)]
    return d.lagrange()


def _platform(
    d: Description, x, y, phi, wheels: Sequence, b, dd, r, m_c, m_w, I_c, I_w, I_m, torques: Sequence
):
    """The LABMATE's bodies and contacts; answers the frame of the platform and its centre of mass."""
    N, B = d.N, d.N.orientnew("B", "Axis", (phi, d.N.z))
    centre = d.point("P_c", d.O, x * N.x + y * N.y)
    axle = d.point("P_o", centre, -dd * B.x)
    d.body("platform", centre, B, m_c, (0, 0, I_c))
    d.contact(axle.vel(N), B.y)
    for name, side, theta, tau in zip(("right", "left"), (-1, 1), wheels, torques, strict=True):
        W = B.orientnew(name, "Axis", (theta, B.y))
        hub = d.point(f"hub_{name}", axle, side * b * B.y)
        d.body(name, hub, W, m_w, (I_m, I_w, I_m))
        d.contact(hub.vel(N) + W.ang_vel_in(N).cross(-r * N.z), B.x)
        d.loads += [(W, tau * B.y), (B, -tau * B.y)]
    return B, centre


LABMATE = "b d r m_c m_w I_c I_w I_m"


def castor_platform() -> Motion:
    names = "x y phi theta_r theta_l beta_r gamma_r beta_l gamma_l"
    d = Description(names, "tau_r tau_l", "b d r m I I_w e f c r_k m_k I_k I_r")
    x, y, phi, theta_r, theta_l, *castors = d.q
    b, ahead, r, m, I, I_w, e, f, trail, r_k, m_k, I_k, I_r = d.parameters  # noqa: E741
    N, B = d.N, d.N.orientnew("B", "Axis", (phi, d.N.z))
    axle = d.point("P_o", d.O, x * N.x + y * N.y)
    d.body("platform", d.point("P_c", axle, ahead * B.x), B, m, (0, 0, I))
    d.contact(axle.vel(N), B.y)
    both = zip((-1, 1), (theta_r, theta_l), d.inputs, (castors[:2], castors[2:]), strict=True)
    for side, theta, tau, (beta, gamma) in both:
        W = B.orientnew(f"driven_{side}", "Axis", (theta, B.y))
        C = B.orientnew(f"castor_{side}", "Axis", (beta, B.z))
        K = C.orientnew(f"wheel_{side}", "Axis", (gamma, C.y))
        hub = d.point(f"hub_{side}", axle, side * b * B.y)
        own = d.point(f"hub_of_castor_{side}", axle, e * B.x + side * f * B.y - trail * C.x)
        d.body(f"driven {side}", hub, W, 0, (0, I_w, 0))
        d.body(f"castor {side}", own, C, m_k, (0, 0, I_k))
        d.body(f"wheel {side}", own, K, 0, (0, I_r, 0))
        d.contact(hub.vel(N) + W.ang_vel_in(N).cross(-r * N.z), B.x)
        d.contact(own.vel(N) + K.ang_vel_in(N).cross(-r_k * N.z), C.x, C.y)
        d.loads += [(W, tau * B.y), (B, -tau * B.y)]
    return d.lagrange()


def mecanum() -> Motion:
    """Wheels as discs; the point of the rim on the ground slides across the axis of its roller only."""
    names = "x y phi theta_fr theta_fl theta_rr theta_rl"
    d = Description(names, "tau_fr tau_fl tau_rr tau_rl", "l_x l_y r gamma m I_z I_w")
    x, y, phi, *angles = d.q
    l_x, l_y, r, gamma, m, I_z, I_w = d.parameters
    N, B = d.N, d.N.orientnew("B", "Axis", (phi, d.N.z))
    middle = d.point("M", d.O, x * N.x + y * N.y)
    d.body("platform", middle, B, m, (0, 0, I_z))
    for k, (theta, tau) in enumerate(zip(angles, d.inputs, strict=True)):
        ahead, aside = (1, -1)[k // 2], (-1, 1)[k % 2]
        W = B.orientnew(f"wheel_{k}", "Axis", (theta, B.y))
        R = B.orientnew(f"roller_{k}", "Axis", (-ahead * aside * gamma, B.z))
        hub = d.point(f"hub_{k}", middle, ahead * l_x * B.x + aside * l_y * B.y)
        d.body(f"wheel {k}", hub, W, 0, (0, I_w, 0))
        d.contact(hub.vel(N) + W.ang_vel_in(N).cross(-r * N.z), R.x)
        d.loads += [(W, tau * B.y), (B, -tau * B.y)]
    return d.lagrange()


def slope_platform() -> Motion:
    d = Description("x_c y_c phi theta_r theta_l", "tau_r tau_l", f"{LABMATE} slope g c")
    x, y, phi, *wheels = d.q
    *sizes, slope, g, c = d.parameters
    torques = [tau - c * theta.diff(t) for tau, theta in zip(d.inputs, wheels, strict=True)]
    _platform(d, x, y, phi, wheels, *sizes, torques)
    weight = -g * (sp.sin(slope) * d.N.x + sp.cos(slope) * d.N.z)
    d.potential = -sum(body.mass * weight.dot(body.masscenter.pos_from(d.O)) for body in d.bodies)
    return d.lagrange()


def mobile_manipulator() -> Motion:
    d = Description(
        "x_c y_c phi theta_r theta_l q_1 q_2",
        "tau_r tau_l tau_1 tau_2",
        f"{LABMATE} a l_1 l_2 m_1 m_2 I_1 I_2",
    )
    x, y, phi, theta_r, theta_l, q_1, q_2 = d.q
    *sizes, a, l_1, l_2, m_1, m_2, I_1, I_2 = d.parameters
    *torques, tau_1, tau_2 = d.inputs
    B, centre = _platform(d, x, y, phi, (theta_r, theta_l), *sizes, torques)
    first = B.orientnew("first", "Axis", (q_1, B.z))
    second = first.orientnew("second", "Axis", (q_2, B.z))
    base = d.point("base", centre, a * B.x)
    elbow = d.point("elbow", base, l_1 * first.x)
    d.body("link 1", d.point("C_1", base, l_1 / 2 * first.x), first, m_1, (0, 0, I_1))
    d.body("link 2", d.point("C_2", elbow, l_2 / 2 * second.x), second, m_2, (0, 0, I_2))
    d.loads += [(first, (tau_1 - tau_2) * B.z), (B, -tau_1 * B.z), (second, tau_2 * B.z)]
    return d.kane()


def geared_arm() -> Motion:
    d = Description("q_1 q_2 theta_1 theta_2", "tau_1 tau_2", "l_1 l_2 c_1 c_2 m_1 m_2 I_1 I_2 J N g")
    q_1, q_2, theta_1, theta_2 = d.q
    tau_1, tau_2 = d.inputs
    l_1, l_2, c_1, c_2, m_1, m_2, I_1, I_2, J, ratio, g = d.parameters
    N = d.N
    first = N.orientnew("first", "Axis", (q_1, N.z))
    second = first.orientnew("second", "Axis", (q_2, N.z))
    rotors = (
        N.orientnew("rotor_1", "Axis", (theta_1, N.z)),
        first.orientnew("rotor_2", "Axis", (theta_2, N.z)),
    )
    elbow = d.point("elbow", d.O, l_1 * first.x)
    d.body("link 1", d.point("C_1", d.O, c_1 * first.x), first, m_1, (0, 0, I_1))
    d.body("link 2", d.point("C_2", elbow, c_2 * second.x), second, m_2, (0, 0, I_2))
    for rotor in rotors:
        d.body(rotor.name, d.O, rotor, 0, (0, 0, J))
    d.potential = sum(body.mass * g * body.masscenter.pos_from(d.O).dot(N.y) for body in d.bodies)
    d.loads = [(rotors[0], tau_1 * N.z), (rotors[1], tau_2 * N.z), (first, -tau_2 * N.z)]
    return d.lagrange([theta_1 - ratio * q_1, theta_2 - ratio * q_2])


DERIVATIONS: dict[str, Callable[[], Motion]] = {
    "knife_edge": knife_edge,
    "rolling_disk": rolling_disk,
    "car": lambda: _steered(driven_in_front=False),
    "tricycle": lambda: _steered(driven_in_front=True),
    "ball_plate": ball_plate,
    "mobile_manipulator": mobile_manipulator,
    "geared_arm": geared_arm,
    "slope_platform": slope_platform,
    "bus": lambda: _steered(driven_in_front=False, linked=True),
    "castor_platform": castor_platform,
    "mecanum": mecanum,
}


@cache
def motion(name: str) -> Motion:
    """The independent derivation of a shipped robot, made once."""
    return DERIVATIONS[name]()
