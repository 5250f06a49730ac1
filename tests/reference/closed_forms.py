"""The LABMATE in closed form, an oracle that shares nothing with the generator: the paper's matrices, and
what follows from them.

Everything symbolic is SymPy; numbers are evaluated with 30 digits and rounded once. `lagrange_equations` and
`rolling_rows` derive the same matrices a second time, from the motion of the bodies.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property

import mpmath
import numpy as np
import sympy as sp

COORDINATES = x_c, y_c, phi, theta_r, theta_l = sp.symbols("x_c y_c phi theta_r theta_l", real=True)
QUASI_VELOCITIES = nu_1, nu_2 = sp.symbols("thetadot_r thetadot_l", real=True)
PARAMETERS = b, d, r, m_c, m_w, I_c, I_w, I_m = sp.symbols("b d r m_c m_w I_c I_w I_m", positive=True)
RATES = sp.symbols("x_c_dot y_c_dot phi_dot theta_r_dot theta_l_dot", real=True)
L = sp.Symbol("config.L", real=True)
DIGITS = 30

q, nu, qdot = sp.Matrix(COORDINATES), sp.Matrix(QUASI_VELOCITIES), sp.Matrix(RATES)
sin, cos = sp.sin(phi), sp.cos(phi)
c = r / (2 * b)
l = L + d  # noqa: E741  P_l's distance ahead of the axle
m = m_c + 2 * m_w
I = I_c + 2 * m_w * (d**2 + b**2) + 2 * I_m  # noqa: E741

A = sp.Matrix([[-sin, cos, -d, 0, 0], [-cos, -sin, -b, r, 0], [-cos, -sin, b, 0, r]])
S = sp.Matrix(
    [
        [c * (b * cos - d * sin), c * (b * cos + d * sin)],
        [c * (b * sin + d * cos), c * (b * sin - d * cos)],
        [c, -c],
        [1, 0],
        [0, 1],
    ]
)
M = sp.Matrix(
    [
        [m, 0, 2 * m_w * d * sin, 0, 0],
        [0, m, -2 * m_w * d * cos, 0, 0],
        [2 * m_w * d * sin, -2 * m_w * d * cos, I, 0, 0],
        [0, 0, 0, I_w, 0],
        [0, 0, 0, 0, I_w],
    ]
)
V_OF_RATES = sp.Matrix([2 * m_w * d * RATES[2] ** 2 * cos, 2 * m_w * d * RATES[2] ** 2 * sin, 0, 0, 0])
V = V_OF_RATES.subs(RATES[2], c * (nu_1 - nu_2))
E = sp.Matrix([[0, 0], [0, 0], [0, 0], [1, 0], [0, 1]])
# S'MS by hand: the platform turns about P_o with inertia J = I + m d^2 - 4 m_w d^2.
J = I + m * d**2 - 4 * m_w * d**2
MBAR = sp.Matrix([[m * r**2 / 4 + J * c**2 + I_w, m * r**2 / 4 - J * c**2], [0, 0]])
MBAR[1, 0], MBAR[1, 1] = MBAR[0, 1], MBAR[0, 0]
BIAS = m_c * d * r**3 / (4 * b**2) * sp.Matrix([nu_2 * (nu_1 - nu_2), -nu_1 * (nu_1 - nu_2)])


def along_motion(expression: sp.Matrix) -> sp.Matrix:
    """Time derivative along qdot = S nu."""
    return sum(
        (expression.diff(x) * rate for x, rate in zip(q, S * nu, strict=True)), sp.zeros(*expression.shape)
    )


def lagrange_equations() -> tuple[sp.Matrix, sp.Matrix]:
    """M and V(q, qdot) from Lagrange's equations of the platform and two wheels, each a function of time."""
    t = sp.Symbol("t")
    of_time = sp.Matrix([sp.Function(str(symbol))(t) for symbol in q])
    x, y, heading, right_angle, left_angle = of_time
    forward, left = (
        sp.Matrix([sp.cos(heading), sp.sin(heading)]),
        sp.Matrix([-sp.sin(heading), sp.cos(heading)]),
    )
    axle = sp.Matrix([x, y]) - d * forward
    kinetic = (m_c * (x.diff(t) ** 2 + y.diff(t) ** 2) + I_c * heading.diff(t) ** 2) / 2
    for wheel, angle in ((axle - b * left, right_angle), (axle + b * left, left_angle)):
        velocity = wheel.diff(t)
        kinetic += (m_w * velocity.dot(velocity) + I_m * heading.diff(t) ** 2 + I_w * angle.diff(t) ** 2) / 2
    accelerations = sp.symbols("a0:5")
    equations = sp.Matrix([kinetic.diff(f.diff(t)).diff(t) - kinetic.diff(f) for f in of_time])
    equations = equations.subs({f.diff(t, 2): a for f, a in zip(of_time, accelerations, strict=True)})
    equations = equations.subs({f.diff(t): rate for f, rate in zip(of_time, qdot, strict=True)})
    equations = equations.subs(dict(zip(of_time, q, strict=True))).expand()
    return equations.jacobian(accelerations), equations.subs({a: 0 for a in accelerations})


def rolling_rows() -> sp.Matrix:
    """A from the velocities of P_o (no side slip) and of the wheels' centres (as fast as the wheel turns)."""
    forward, left = sp.Matrix([cos, sin]), sp.Matrix([-sin, cos])
    axle = q[:2, :] - d * forward

    def velocity(point: sp.Matrix) -> sp.Matrix:
        return point.jacobian(q) * qdot

    rows = [
        velocity(axle).dot(left),
        r * qdot[3] - velocity(axle - b * left).dot(forward),
        r * qdot[4] - velocity(axle + b * left).dot(forward),
    ]
    return sp.Matrix(rows).jacobian(qdot)


@dataclass(frozen=True)
class Output:
    """An output map of the paper: h(q, nu), the relative degree of each row and det Phi as the paper's table
    has it."""

    h: sp.Matrix
    relative_degree: tuple[int, int]
    determinant: sp.Expr
    config: tuple[sp.Symbol, ...]

    @cached_property
    def Phi(self) -> sp.Matrix:
        """Decoupling matrix (15); a row of degree 1 is dh/dnu."""
        by_position, by_velocity = self.h.jacobian(q) * S, self.h.jacobian(nu)
        return sp.Matrix.vstack(
            *[(by_velocity if k == 1 else by_position)[i, :] for i, k in enumerate(self.relative_degree)]
        )

    @cached_property
    def Phidot(self) -> sp.Matrix:
        """dPhi/dt along the motion."""
        return along_motion(self.Phi)

    @cached_property
    def rate(self) -> sp.Matrix:
        """First derivatives of all rows, u = 0."""
        return along_motion(self.h)

    @cached_property
    def drift(self) -> sp.Matrix:
        """What the highest derivatives are without u."""
        twice = self.Phidot * nu
        return sp.Matrix([self.rate[i] if k == 1 else twice[i] for i, k in enumerate(self.relative_degree)])


def _outputs() -> dict[str, Output]:
    x_l, y_l = x_c + L * cos, y_c + L * sin
    speed = r * (nu_1 + nu_2) / 2
    line_A, line_B, line_C, x_f, y_f, R = (
        sp.Symbol(f"config.{name}", real=True) for name in ("A", "B", "C", "x_f", "y_f", "R")
    )
    half_x, half_y = (sp.Symbol(f"config.{name}", positive=True) for name in ("a", "b"))
    norm, distance = sp.sqrt(line_A**2 + line_B**2), sp.sqrt((x_l - x_f) ** 2 + (y_l - y_f) ** 2)
    f, slope_x, slope_y = (
        (x_l / half_x) ** 2 + (y_l / half_y) ** 2 - 1,
        2 * x_l / half_x**2,
        2 * y_l / half_y**2,
    )
    ellipse = f / sp.sqrt(slope_x**2 + slope_y**2)
    # det Phi of Type IV for any h1: with g = grad h1 at P_l it is r^2 l (g_y cos phi - g_x sin phi)/(2b). On
    # the ellipse g = grad f/|grad f| - f H grad f/|grad f|^3 with the Hessian H of f.
    cube = sp.sqrt(slope_x**2 + slope_y**2) ** 3
    g_x = slope_x * (cube ** sp.Rational(2, 3) - f * 2 / half_x**2) / cube
    g_y = slope_y * (cube ** sp.Rational(2, 3) - f * 2 / half_y**2) / cube
    # A line or arc by its centre, 1/curvature to the left of the point.
    x_s, y_s, direction, curvature = (
        sp.Symbol(f"config.{name}", real=True) for name in ("x_s", "y_s", "direction", "curvature")
    )
    from_centre = sp.Matrix(
        [x_l - x_s + sp.sin(direction) / curvature, y_l - y_s - sp.cos(direction) / curvature]
    )
    radius = sp.sqrt(from_centre.dot(from_centre))
    inward = -sp.sign(curvature) * from_centre / radius
    four = r**2 * l / (2 * b)
    return {
        "type_i": Output(sp.Matrix([x_l, y_l]), (2, 2), -(r**2) * l / (2 * b), (L,)),
        "type_ii": Output(sp.Matrix([x_l, phi]), (2, 2), -(r**2) * cos / (2 * b), (L,)),
        "type_iii": Output(sp.Matrix([y_l, phi]), (2, 2), -(r**2) * sin / (2 * b), (L,)),
        "type_iv_line": Output(
            sp.Matrix([(line_A * x_l + line_B * y_l + line_C) / norm, speed]),
            (2, 1),
            four * (line_B * cos - line_A * sin) / norm,
            (L, line_A, line_B, line_C),
        ),
        "type_iv_circle": Output(
            sp.Matrix([distance - R, speed]),
            (2, 1),
            four * ((y_c - y_f) * cos - (x_c - x_f) * sin) / distance,
            (L, x_f, y_f, R),
        ),
        "type_iv_ellipse": Output(
            sp.Matrix([ellipse, speed]), (2, 1), four * (g_y * cos - g_x * sin), (L, half_x, half_y)
        ),
        "type_iv_segment": Output(
            sp.Matrix([1 / curvature - sp.sign(curvature) * radius, speed]),
            (2, 1),
            four * (inward[1] * cos - inward[0] * sin),
            (L, x_s, y_s, direction, curvature),
        ),
    }


OUTPUTS = _outputs()
TYPE_I_PHI = c * sp.Matrix([[b * cos - l * sin, b * cos + l * sin], [b * sin + l * cos, b * sin - l * cos]])
STATE = (*PARAMETERS, *COORDINATES, *QUASI_VELOCITIES)


@cache
def _platform_function():
    return sp.lambdify(STATE, [M, V, A, S, along_motion(S), MBAR, BIAS], "mpmath", cse=True)


@cache
def _output_function(law: str):
    output = OUTPUTS[law]
    quantities = [
        output.h,
        output.rate,
        output.Phi,
        output.Phidot,
        output.drift,
        sp.Matrix([output.determinant]),
    ]
    return sp.lambdify((*STATE, *output.config), quantities, "mpmath", cse=True)


def _numbers(matrix: mpmath.matrix) -> np.ndarray:
    return np.array(matrix.tolist(), dtype=float)


def platform(values: Mapping[str, float]) -> dict[str, np.ndarray]:
    """M, V, A, S, Sdot, Mbar, bias at the state and parameters `values`."""
    with mpmath.workdps(DIGITS):
        names = ("M", "V", "A", "S", "Sdot", "Mbar", "bias")
        matrices = _platform_function()(*[mpmath.mpf(values[str(s)]) for s in STATE])
        return {name: _numbers(matrix) for name, matrix in zip(names, matrices, strict=True)}


def law(
    name: str, values: Mapping[str, float], gains: tuple[float, float, float], reference: np.ndarray
) -> dict[str, np.ndarray]:
    """h, ydot, Phi, Phidot, det, u, tau, lam of one law.

    `gains` are kp, kd, kv; `reference` has a row (y, yd, ydd) for each output, a row of degree 1 leaves the
    middle unused. tau follows (12) with S'E = 1; lambda from the whole system M qddot + A' lambda = E tau -
    V, A qddot = -Adot qdot.
    """
    output = OUTPUTS[name]
    kp, kd, kv = gains
    with mpmath.workdps(DIGITS):
        at = [mpmath.mpf(values[str(s)]) for s in STATE]
        mass, forces, rolling, free, free_rate, reduced, bias = _platform_function()(*at)
        config = [mpmath.mpf(values[str(s)]) for s in output.config]
        h, rate, Phi, Phidot, drift, determinant = _output_function(name)(*at, *config)
        v = mpmath.matrix(2, 1)
        for i, degree in enumerate(output.relative_degree):
            y, yd, ydd = (mpmath.mpf(number) for number in reference[i])
            v[i] = ydd + kd * (yd - rate[i]) + kp * (y - h[i]) if degree == 2 else ydd + kv * (y - h[i])
        u = mpmath.lu_solve(Phi, v - drift)
        tau = reduced * u + bias
        velocity = mpmath.matrix(at[-2:])
        # A qddot = -Adot qdot = A Sdot nu, because A S = 0 at all times.
        right = [*(mpmath.matrix([0, 0, 0, *tau]) - forces), *(rolling * (free_rate * velocity))]
        whole = mpmath.matrix(8, 8)
        whole[:5, :5], whole[:5, 5:], whole[5:, :5] = mass, rolling.T, rolling
        lam = mpmath.lu_solve(whole, mpmath.matrix(right))[5:]
        degree_two = [rate[i] for i, degree in enumerate(output.relative_degree) if degree == 2]
        exact = {
            "h": h,
            "Phi": Phi,
            "Phidot": Phidot,
            "u": u,
            "tau": tau,
            "lam": mpmath.matrix(lam),
            "det": determinant,
        }
        return {"ydot": np.array([float(number) for number in degree_two])} | {
            k: _numbers(x).squeeze() for k, x in exact.items()
        }
