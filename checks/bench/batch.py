"""Closed loops per second and core: the batch simulator compared with SciPy, CasADi, NumPy and numba at equal accuracy; gain by
vectors, by a second thread and by workers on this machine.

The LABMATE on the line of line.toml, 10 s, the controller called at 100 Hz and its torque held. SciPy integrates the plant
in NumPy from call to call and is given the compiled law; CasADi runs all calls as one function, cvodes from call to call. Of
each the loosest tolerance counts that meets the accuracy; of the loops of loops.py, which do not estimate their error, the fewest
steps. Times are those of the processor, not of the clock, except those of threads and workers.
Adds "sweep" to bench.json.
"""

import argparse
import json
import os
import resource
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import casadi as ca
import distributed
import loops
import noslip
import numpy as np
from noslip.model.law import ControlLaw
from noslip.readers.files import write_whole
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.controller import Controller
from noslip.simulation.loop import Loop, make_loop
from noslip.simulation.specification.spec import Spec, read_spec
from noslip.simulation.sweeping.batch import Batch
from noslip.simulation.sweeping.cluster import Cluster
from noslip.simulation.sweeping.runner import TableRunner, Threads
from noslip.simulation.sweeping.study import study_of
from scipy.integrate import solve_ivp

ROOT = Path(noslip.__file__).parent
ACCURACY = 1e-8  # largest error of the state at the end, SI
FINE = 1e-12  # the same, for loops of fixed steps
DURATION, PERIOD = 10.0, 0.01  # s
SAMPLES = 1000
GROWTH = (10, 100, 1000, 4000)
REPEATS = 3  # the shortest time counts
WANTED = {"scipy": 1000.0, "cvodes": 50.0, "NumPy loop": 5.0, "numba loop": 5.0, "threads": 1.9}
LOOPS = {"NumPy loop": loops.in_numpy, "numba loop": loops.in_numba}
VECTORS = {"scalar": 0, "plain": 1, "avx2": 2, "avx512": 3}
WORKERS = (1, 2, 3)
SWEPT, PART = 20000, 1000  # samples for the workers
MOST_STEPS = 20


def main() -> int:
    """Measure, print, and add the results to bench.json; return 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", dest="out", metavar="DIR", default="build", help="where bench.json is (default: build)")
    file = Path(parser.parse_args().out) / "bench.json"
    result = measure()
    print(table(result))
    known = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    write_whole(file, json.dumps(known | {"sweep": result}, indent=1) + "\n")
    return 0


def measure() -> dict:
    """Return rates in runs per second, errors, and ratios to ours."""
    spec = read_spec(ROOT / "examples/specs/line.toml")
    spec = replace(spec, simulation=replace(spec.simulation, duration=DURATION, period=PERIOD))
    truth, loop, batch = simulate(spec).x[-1], make_loop(spec), Batch(spec)
    last = [batch.outcomes.index(f"end.{q.name}") for q in loop.law.state]
    samples = batch.table({}, SAMPLES)
    ours = SAMPLES / _least(lambda: batch.run(samples))
    result: dict = {
        "duration_s": DURATION,
        "period_s": PERIOD,
        "accuracy": ACCURACY,
        "runs_per_second": round(ours, 1),
        "error": float(np.abs(batch.run(samples[:1])[0, last] - truth).max()),
        "peers": {},
    }
    for name, way in _ways(spec).items():
        chosen = next((one for k in range(3, 13) if _error((one := way(10.0**-k))(), truth) <= ACCURACY), None)
        if chosen is not None:
            seconds, error = _least(chosen), float(np.abs(chosen() - truth).max())
            result["peers"][name] = {"seconds_per_run": round(seconds, 5), "error": error, "times": round(seconds * ours, 1)}
    for name, loop_of in LOOPS.items():
        for suffix, accuracy in (("", ACCURACY), (f" to {FINE:g}", FINE)):
            found = _loop(loop_of, loop, spec, truth, accuracy)
            if found is not None:
                result["peers"][name + suffix] = {**found, "times": round(found["seconds_per_run"] * ours, 1)}
    result["vectors"] = {
        name: round(SAMPLES / _least(lambda one=one: one.run(samples)), 1)
        for name, size in VECTORS.items()
        if (one := Batch(spec, vectors=size)).vectors == name
    }
    result["workers"] = _workers()
    result["threads"] = _threads(batch)
    result["growth"] = {str(n): round(n / _least(lambda n=n: batch.run(batch.table({}, n))), 1) for n in GROWTH}
    result["peak_memory_MB"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    return result


def table(result: dict) -> str:
    """Return the results as text."""
    each = f"{DURATION:g} s at {1 / PERIOD:g} Hz"
    lines = [f"batch: {result['runs_per_second']:.0f} runs/s and core ({each}), error {result['error']:.0e}"]
    for name, found in result["peers"].items():
        wanted = next(value for peer, value in WANTED.items() if peer in name)
        lines.append(
            f"  {name}: {found['seconds_per_run']:.4f} s a run, error {found['error']:.0e}: "
            f"ours is {found['times']:.0f} times as fast (wanted {wanted:g})"
        )
    alone = result["vectors"]["scalar"]
    lines.append("  vectors: " + ", ".join(f"{n} {rate / alone:.1f} times scalar" for n, rate in result["vectors"].items()))
    clock = result["workers"]
    each = ", ".join(f"{n}: {clock['1'] / clock[str(n)]:.2f}" for n in WORKERS)
    lines.append(f"  Dask workers on this machine, times one by the clock: {each}")
    lines.append(f"  one worker takes {clock['1'] / clock['none']:.2f} times as long as a thread without Dask")
    threads = result["threads"]
    lines.append(
        f"  2 threads: {threads['1'] / threads['2']:.2f} times 1 by the clock (wanted {WANTED['threads']:g}); before, other work "
        f"took {threads['load']:.1f} of {os.cpu_count()} cores"
    )
    lines.append("  runs/s of N samples: " + ", ".join(f"{n}: {rate:.0f}" for n, rate in result["growth"].items()))
    return "\n".join(lines)


def _loop(loop_of: Callable, loop: Loop, spec: Spec, truth: np.ndarray, accuracy: float) -> dict[str, float] | None:
    """Return seconds per run, error and steps in a period of a loop with the fewest steps that are as accurate; None if it is not
    installed or never is."""
    for steps in range(1, MOST_STEPS):
        run = loop_of(loop, spec.gains, SAMPLES, round(DURATION / PERIOD), PERIOD, steps)
        if run is None:
            return None
        if (error := _error(run()[:, 0], truth)) <= accuracy:
            return {"seconds_per_run": round(_least(run) / SAMPLES, 7), "error": error, "steps": steps}
    return None


def _workers() -> dict[str, float]:
    """Return seconds by the clock of the sweep of sweep.toml, without Dask in one thread, and with workers on this machine,
    each with a thread."""
    place = ROOT / "examples/specs/sweep.toml"
    study = study_of(place.read_text(encoding="utf-8"), str(place), SWEPT)
    parts = [(k, study.plan.table(k * PART, PART)) for k in range(SWEPT // PART)]

    def seconds(runner: TableRunner) -> float:
        list(runner.results((k, parts[0][1]) for k in range(4 * max(WORKERS))))  # every worker has compiled the C
        return _clock(runner, parts)

    found = {"none": seconds(Threads(study.batch, 1))}
    for count in WORKERS:
        with distributed.LocalCluster(count, threads_per_worker=1, dashboard_address=None, silence_logs="CRITICAL") as cluster:
            runner = Cluster(cluster.scheduler_address, study)
            found[str(count)] = seconds(runner)
            runner.close()
    return found


def _threads(batch: Batch) -> dict[str, float]:
    """Return seconds by the clock of SWEPT samples in parts, by the number of threads; `load`: of the processors, before."""
    load = os.getloadavg()[0]
    parts = [(k, batch.table({}, PART)) for k in range(SWEPT // PART)]
    clock = {str(n): min(_clock(Threads(batch, n), parts) for _ in range(REPEATS)) for n in (1, 2)}
    return clock | {"load": round(load, 1)}


def _clock(runner: TableRunner, parts: list[tuple[int, np.ndarray]]) -> float:
    """Return the seconds by the clock of parts of a sweep."""
    begin = time.perf_counter()
    list(runner.results(parts))
    return round(time.perf_counter() - begin, 3)


def _least(action: Callable[[], object]) -> float:
    """Return the processor time of an action, s, the shortest of several."""
    times = []
    for _ in range(REPEATS):
        begin = time.process_time()
        action()
        times.append(time.process_time() - begin)
    return min(times)


def _error(x: np.ndarray, truth: np.ndarray) -> float:
    error = float(np.abs(x - truth).max())
    return error if np.isfinite(error) else np.inf


def _ways(spec: Spec) -> dict[str, Callable[[float], Callable[[], np.ndarray]]]:
    """Return name -> function from a tolerance to a run that returns the last state."""
    loop = make_loop(spec)
    wanted, controller = loop.guidance.reference(0.0, loop.start), loop.guidance.leg.controller
    rate = _numpy_rate(loop.plant.parameters)
    methods = ("RK45", "DOP853", "LSODA")
    ways = {f"scipy {m}, NumPy": lambda tol, m=m: lambda: _scipy(rate, controller, wanted, loop.start, m, tol) for m in methods}
    return ways | {"CasADi cvodes": lambda tol: _cvodes(loop, spec, wanted, tol)}


def _scipy(rate: Callable, controller: Controller, wanted: np.ndarray, x: np.ndarray, method: str, tol: float) -> np.ndarray:
    options = {"method": method, "rtol": tol, "atol": tol, "first_step": PERIOD}
    for _ in range(round(DURATION / PERIOD)):
        _, tau = controller.step(x, wanted)
        x = solve_ivp(rate, (0.0, PERIOD), x, args=(tau,), **options).y[:, -1]
    return x


def _cvodes(loop, spec: Spec, wanted: np.ndarray, tol: float) -> Callable[[], np.ndarray]:
    """Return all calls as one CasADi function, built beforehand."""
    law: ControlLaw = loop.law
    system, count = law.system, round(DURATION / PERIOD)
    x, tau = ca.SX.sym("x", len(law.state)), ca.SX.sym("tau", len(system.mechanism.inputs))
    state, known = ca.vertcat(*[q.symbol for q in law.state]), ca.SX(loop.plant.parameters)
    ode = ca.vertcat(system.qdot, system.acceleration(tau))
    ode = ca.cse(ca.substitute(ode, ca.vertcat(state, system.mechanism.p), ca.vertcat(x, known)))
    options = {"reltol": tol, "abstol": tol, "max_num_steps": 10**6}
    plant = ca.integrator("plant", "cvodes", {"x": x, "p": tau, "ode": ode}, 0.0, PERIOD, options)
    gains = [spec.gains[gain.name[:2]] for gain in law.gains]
    control = law.function({"tau": ca.cse(law.tau)})
    at = ca.MX.sym("x", len(law.state))
    held = control(loop.plant.parameters, loop.guidance.leg.config, gains, at, wanted)
    run = ca.Function("call", [at], [plant(x0=at, p=held)["xf"]]).mapaccum(count)
    return lambda: run(loop.start).full()[:, -1]


def _numpy_rate(parameters: np.ndarray) -> Callable[[float, np.ndarray, np.ndarray], np.ndarray]:
    """Return the plant (11) as commonly written in NumPy, with constants computed beforehand."""
    b, d, r, m_c, m_w, I_c, I_w, I_m = parameters
    c = r / (2 * b)
    mass, inertia = m_c + 2 * m_w + 2 * I_w / r**2, I_c + m_c * d**2 + 2 * (I_m + m_w * b**2 + I_w * b**2 / r**2)
    W = np.array([[r / 2, r / 2], [c, -c]])  # forward speed and yaw rate
    Mbar = W.T @ np.diag([mass, inertia]) @ W
    inverse = np.linalg.inv(Mbar)

    def rate(_: float, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
        sin, cos = np.sin(x[2]), np.cos(x[2])
        nu = x[5:]
        v, omega = W @ nu
        bias = W.T @ np.array([-m_c * d * omega**2, m_c * d * v * omega])
        S = np.array([[cos, -d * sin], [sin, d * cos], [0, 1]])
        return np.concatenate([S @ (v, omega), nu, inverse @ (tau - bias)])

    return rate


if __name__ == "__main__":
    raise SystemExit(main())
