"""Threads may share a controller, a tracker, dead reckoning or an integrator:
the answers are those that one thread gets."""

import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import astuple

import pytest
from noslip.checks.verification.sampling import random_plants
from noslip.model.segments import Segment
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.controller import BACKENDS
from noslip.simulation.controllers.integral import make_integral
from noslip.simulation.controllers.odometry import make_odometry
from noslip.simulation.controllers.tracking import TrackerOptions, make_tracker

THREADS, CALLS = 6, 1000
each_backend = pytest.mark.parametrize("backend", BACKENDS)


def in_threads(call: Callable[[int], object]) -> list:
    """Answers of call(0), call(1), ... from several threads that are often interrupted."""
    interval = sys.getswitchinterval()
    try:
        sys.setswitchinterval(1e-6)
        with ThreadPoolExecutor(THREADS) as pool:
            parts = pool.map(
                lambda first: [call(k) for k in range(first, THREADS * CALLS, THREADS)], range(THREADS)
            )
            return [answer for part in parts for answer in part]
    finally:
        sys.setswitchinterval(interval)


@each_backend
def test_a_controller(backend):
    law = law_of(find_robot("labmate"), "type_i")
    (plant,) = random_plants(law, 20, seed=16)
    controller = make_controller(backend, law, plant.params, plant.config, plant.gains)

    def answer(k: int) -> list:
        point = plant.points[k % len(plant.points)]
        seen = point.state, point.reference
        return [k, *controller.step(*seen)[1], *controller.evaluate(*seen).values["Phi"].flat]

    assert sorted(in_threads(answer)) == [answer(k) for k in range(THREADS * CALLS)]


def odometry(backend: str):
    """The next pose on a circle."""
    made = make_odometry(backend, (0.05, 0.05), (0.1, -0.1), 0.2, release=1e9, start=(1.0, 2.0, 0.5))
    made.correct((1.5, 2.5, 0.4), "bumpless")
    return made, lambda k: tuple(made.move((0.1, 0.09), 0.01))


def integral(backend: str):
    """The next integral of a constant."""
    made = make_integral(backend, 0.5)
    return made, lambda k: made.step(0.25, 0.125, "ok")


def tracker(backend: str):
    """The guide at one of many places beside a line; one of them is the first."""
    made = make_tracker(backend, [Segment(0, 0, 0, 0, 100)], TrackerOptions(speed=1, L=(0.5, 0)))
    return made, lambda k: astuple((made.look if k % 3 else made.update)(k % 90, k % 7, 0.1 * (k % 11), 1.0))


@each_backend
@pytest.mark.parametrize("make", [odometry, integral, tracker])
def test_what_remembers(make, backend):
    """All that several threads are answered is, in some order, what one thread is answered."""
    alone, shared = (make(backend)[1] for _ in range(2))
    assert sorted(in_threads(shared)) == sorted(map(alone, range(THREADS * CALLS)))


@pytest.mark.parametrize("make", [odometry, tracker])
def test_without_taking_turns_answers_are_wrong(make):
    """The test above can fail."""
    alone = sorted(map(make("cf")[1], range(THREADS * CALLS)))
    for _ in range(20):
        made, shared = make("cf")
        made._lock = nullcontext()
        if sorted(in_threads(shared)) != alone:
            return
    pytest.fail("no answer is wrong")
