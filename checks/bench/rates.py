"""Rates of generating laws and of simulating closed loops, compared with SciPy and CasADi at equal accuracy."""

import ctypes
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
from counting import TIMEOUT, run
from measure import BENCH, COMMON, LANGUAGE, RUNTIME
from noslip.model.law import ControlLaw, symbols
from noslip.simulation.controllers.direct import Direct
from scipy.integrate import solve_ivp

ACCURACIES = (1e-5, 1e-8)  # largest error of the state at the end, SI
DURATION = 20.0  # s
LINE = np.array([0.0, 0.0]), np.array([0.7, 0.7])  # start, m, and velocity, m/s, of the desired point
START = np.array([0.0, 2.0, np.pi / 2, 0.0, 0.0, 0.0, 0.0])
ROBOTS = ("labmate", "mobile_manipulator")  # generated without a cache
REPEATS = 3  # the shortest time counts


def generation(cold: bool) -> dict[str, float | dict[str, float]]:
    """Return the time (s) from the start of the process until all laws of the LABMATE are written, float and double; if `cold`,
    also the processor time (s) of ROBOTS with an empty cache, the C compiler's included."""
    with tempfile.TemporaryDirectory() as folder:
        seconds = round(_least(lambda: _checked(_generate("labmate", folder))), 2)
        return {"seconds": seconds} | ({"cold_processor_seconds": {robot: _cold(robot) for robot in ROBOTS}} if cold else {})


def _generate(robot: str, folder: str) -> list[str]:
    start = "from noslip.cli.main import main; raise SystemExit(main())"
    return [sys.executable, "-c", start, "generate", robot, "-o", folder]


def _cold(robot: str) -> float:
    """Return the processor time (s) to generate the C of a robot, compare it with the model and write it, without a cache."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        _checked(_generate(robot, folder), NOSLIP_CACHE=f"{folder}/cache")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1)


def simulation(law: ControlLaw, fixed: dict[str, np.ndarray], shared: Path, folder: Path) -> dict:
    """Return times for DURATION of the closed loop as ratios to ours, C with fixed steps."""
    loop = _Loop(law, fixed, shared, folder)
    truth = solve_ivp(loop.rate_c, (0, DURATION), START, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    numpy_rate, casadi_rate = _numpy_rate(law, fixed), loop.rate_casadi
    for rate in (numpy_rate, casadi_rate):  # all have the same right-hand side
        for x in (START, truth):
            np.testing.assert_allclose(rate(1.3, x), loop.rate_c(1.3, x), rtol=1e-9, atol=1e-9)
    ways: dict[str, Callable[[float], Callable[[], np.ndarray]]] = {
        "scipy RK45, NumPy": lambda tol: _scipy(numpy_rate, "RK45", tol),
        "scipy RK45, CasADi": lambda tol: _scipy(casadi_rate, "RK45", tol),
        "scipy LSODA, C": lambda tol: _scipy(loop.rate_c, "LSODA", tol),
        "CasADi cvodes": lambda tol: loop.cvodes(tol),
    }
    result: dict = {"duration_s": DURATION}
    for accuracy in ACCURACIES:
        steps = next(n for n in _growing() if _error(loop.run(n), truth) <= accuracy)
        ours = _least(lambda n=steps: loop.run(n), inner=20)
        times = {"ours": 1.0}
        for name, way in ways.items():
            runs = (way(10.0 ** (-k / 2)) for k in range(4, 28))
            chosen = next((one for one in runs if _error(one(), truth) <= accuracy), None)
            times[name] = None if chosen is None else round(_least(chosen) / ours, 1)
        result[f"{accuracy:.0e}"] = {"steps": steps, "microseconds_per_step": round(1e6 * ours / steps, 3), "times": times}
    return result


def _growing():
    n = 100.0
    while True:
        yield int(n)
        n *= 1.1


def _least(action: Callable[[], object], inner: int = 1) -> float:
    """Return the time of an action, s, the shortest of several."""
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        for _ in range(inner):
            action()
        times.append((time.perf_counter() - begin) / inner)
    return min(times)


def _error(x: np.ndarray, truth: np.ndarray) -> float:
    error = float(np.abs(x - truth).max())
    return error if np.isfinite(error) else np.inf


def _checked(command: list[str], **settings: str) -> None:
    subprocess.run(command, check=True, capture_output=True, timeout=TIMEOUT, env={**os.environ, **settings})


def _scipy(rate: Callable, method: str, tolerance: float) -> Callable[[], np.ndarray]:
    return lambda: solve_ivp(rate, (0, DURATION), START, method=method, rtol=tolerance, atol=tolerance).y[:, -1]


class _Loop:
    """The closed loop in C and as a CasADi function."""

    def __init__(self, law: ControlLaw, fixed: dict[str, np.ndarray], shared: Path, folder: Path):
        self.law, self.fixed = law, fixed
        sources = [BENCH / "simulation/loop.c", shared / "labmate.c", shared / "labmate_type_i.c"]
        flags = [flag for flag in ["-O2", *COMMON, *LANGUAGE["c"]] if "callgraph" not in flag]
        run(["gcc", *flags, "-fPIC", "-shared", f"-I{RUNTIME}", f"-I{shared}", *map(str, sources), "-o", "loop.so"], folder)
        self.lib = ctypes.CDLL(str(folder / "loop.so"))
        self.memory = ctypes.create_string_buffer(self.lib.closed_loop_size())
        arrays = [np.ascontiguousarray(a) for a in (*(fixed[g] for g in ("params", "config", "gains")), *LINE)]
        if self.lib.closed_loop_init(self.memory, *map(_pointer, arrays)) != 0:
            raise RuntimeError("the closed loop does not start")
        self.lib.closed_loop_rate.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p]
        self.lib.closed_loop_run.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_int, ctypes.c_void_p]
        self.rate = _casadi_rate(law, fixed)
        self.direct = Direct(self.rate)

    def rate_c(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return xdot from the C."""
        dx = np.empty(7)
        if self.lib.closed_loop_rate(self.memory, t, x.ctypes.data, dx.ctypes.data) < 0:
            raise RuntimeError("the law answers an error")
        return dx

    def rate_casadi(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return xdot from CasADi's virtual machine, through its buffers."""
        return self.direct(np.array([t]), x)[0]

    def run(self, steps: int) -> np.ndarray:
        """Return the state at the end, by Runge-Kutta 4 in C."""
        x = START.copy()
        self.lib.closed_loop_run(self.memory, DURATION, steps, x.ctypes.data)
        return x

    def cvodes(self, tolerance: float) -> Callable[[], np.ndarray]:
        """Return CasADi's integrator, built beforehand."""
        t, x = ca.SX.sym("t"), ca.SX.sym("x", 7)
        options = {"reltol": tolerance, "abstol": tolerance, "max_num_steps": 10**6}
        integrator = ca.integrator("loop", "cvodes", {"t": t, "x": x, "ode": self.rate(t, x)}, 0.0, DURATION, options)
        return lambda: integrator(x0=START)["xf"].full().ravel()


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _casadi_rate(law: ControlLaw, fixed: dict[str, np.ndarray]) -> ca.Function:
    system = law.system
    t, x = ca.SX.sym("t"), symbols(law.state)
    point = LINE[0] + LINE[1] * t
    wanted = ca.vertcat(*[entry for k in (0, 1) for entry in (point[k], LINE[1][k], 0)])
    dx = ca.vertcat(system.qdot, system.acceleration(law.tau))
    groups = [symbols(law.groups[g]) for g in ("params", "config", "gains", "reference")]
    dx = ca.substitute([ca.densify(dx)], groups, [*(ca.SX(fixed[g]) for g in ("params", "config", "gains")), wanted])[0]
    return ca.Function("rate", [t, x], [ca.cse(dx)])


def _numpy_rate(law: ControlLaw, fixed: dict[str, np.ndarray]) -> Callable[[float, np.ndarray], np.ndarray]:
    """Return xdot by the paper's formulas, matrix by matrix, as commonly written in NumPy."""
    b, d, r, m_c, m_w, I_c, I_w, I_m = fixed["params"]
    (L,), (kp_x, kd_x, kp_y, kd_y) = fixed["config"], fixed["gains"]
    kp, kd, c = np.array([kp_x, kp_y]), np.array([kd_x, kd_y]), r / (2 * b)
    m, inertia = m_c + 2 * m_w, I_c + 2 * m_w * (d**2 + b**2) + 2 * I_m

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        sin, cos = np.sin(x[2]), np.cos(x[2])
        nu = x[5:]
        omega = c * (nu[0] - nu[1])
        S = c * np.array([[b * cos - d * sin, b * cos + d * sin], [b * sin + d * cos, b * sin - d * cos], [1, -1]])
        Sdot = c * omega * np.array([[-b * sin - d * cos, -b * sin + d * cos], [b * cos - d * sin, b * cos + d * sin], [0, 0]])
        M = np.array([[m, 0, 2 * m_w * d * sin], [0, m, -2 * m_w * d * cos], [2 * m_w * d * sin, -2 * m_w * d * cos, inertia]])
        V = 2 * m_w * d * omega**2 * np.array([cos, sin, 0])
        Mbar = S.T @ M @ S + I_w * np.eye(2)
        bias = S.T @ (M @ Sdot @ nu + V)
        J = np.array([[1, 0, -L * sin], [0, 1, L * cos]])
        Jdot = omega * np.array([[0, 0, -L * cos], [0, 0, -L * sin]])
        Phi, Phidot = J @ S, J @ Sdot + Jdot @ S
        y = x[:2] + L * np.array([cos, sin])
        v = kp * (LINE[0] + LINE[1] * t - y) + kd * (LINE[1] - Phi @ nu)
        tau = Mbar @ np.linalg.solve(Phi, v - Phidot @ nu) + bias
        return np.concatenate([S @ nu, nu, np.linalg.solve(Mbar, tau - bias)])

    return rate
