"""Results do not depend on the processor: neither on OpenBLAS's kernels, nor on NumPy's,
nor on the C library's."""

import math
import re
from functools import cache
from pathlib import Path

import casadi as ca
import noslip
import numpy as np
import pytest
from mpmath import mp
from noslip.model.algebra.linear_numbers import least_norm, least_squares
from noslip.model.algebra.portable import portable
from noslip.model.algebra.trigonometry import angle_of, arcsine, product, sine_cosine, size, unit
from noslip.simulation.controllers.controller import BACKENDS
from noslip.simulation.runge_kutta import E3, E5, WITHIN_A, WITHIN_C, WITHIN_D, A, B, C
from noslip.tests.processors import SPECS, choices, digest_with, lacking
from scipy.integrate import DOP853

ROOT = Path(noslip.__file__).parent
OLDEST = "all of the oldest"
FEW = [spec for spec in SPECS if spec.stem in ("cusp", "fastest")]  # a wait; a profile and a limiter


def test_sines_and_cosines():
    """Against 120 bits; near multiples of pi/2 too; of floats, arrays and expressions alike."""
    random = np.random.default_rng(1)
    x = [
        random.uniform(-10, 10, 2000),
        random.uniform(-(2.0**20), 2.0**20, 2000),
        np.arange(-300, 300) * (math.pi / 4),
    ]
    x = np.concatenate([*x, 10.0 ** -np.arange(20)])
    found = np.array(sine_cosine(x))
    with mp.workprec(120):
        truth = [[f(mp.mpf(value)) for value in x.tolist()] for f in (mp.sin, mp.cos)]
        rows = zip(truth, found.tolist(), strict=True)
        errors = [
            abs(one - mp.mpf(value)) for right, row in rows for one, value in zip(right, row, strict=True)
        ]
    assert max(errors) < 1.5 * np.finfo(float).eps
    assert np.array_equal(found, np.array([sine_cosine(value) for value in x.tolist()]).T)
    s = ca.SX.sym("s")
    function = portable(ca.Function("both", [s], [ca.vertcat(ca.sin(s), ca.cos(s))]))
    assert np.array_equal(found, function(x[None, :]).full())
    assert all(math.isnan(value) for x in (math.inf, math.nan) for value in sine_cosine(x))


def test_angles():
    """In every direction, and where the series changes; complex numbers as Python has them."""
    random = np.random.default_rng(2)
    y, x = np.concatenate(
        [random.normal(size=(2, 2000)), [np.arange(9.0), np.full(9, 8.0)], [[3.0, -3.0], [0.0, 0.0]]], axis=1
    )
    found = angle_of(y, x)
    with mp.workprec(120):
        points = zip(y.tolist(), x.tolist(), found.tolist(), strict=True)
        errors = [abs(mp.atan2(mp.mpf(a), mp.mpf(b)) - mp.mpf(c)) for a, b, c in points]
    assert max(errors) < 1e-14
    assert (angle_of(0.0, 0.0), angle_of(0.0, -1.0)) == (0.0, math.pi)
    assert arcsine(0.5) == pytest.approx(math.pi / 6, abs=1e-14) and arcsine(-1.0) == -math.pi / 2
    z, w = x + 1j * y, y - 2j * x
    assert np.abs(product(z, w) - z * w).max() < 1e-13 and np.abs(size(z) - abs(z)).max() < 1e-13
    assert abs(unit(2.0) - np.exp(2j)) < 1e-15


def test_functions_without_libm():
    """The same values, and nothing left that the C library computes; names and shapes stay."""
    a, b = ca.SX.sym("a", 2), ca.SX.sym("b")
    made = [ca.sin(a) * ca.cos(a[0] * b), ca.vertcat(ca.tan(b), ca.sqrt(b * b + ca.sin(ca.cos(b)))).T]
    function = ca.Function("some", [a, b], made, ["a", "b"], ["first", "second"])
    found = portable(function)
    codes = {found.instruction_id(k) for k in range(found.n_instructions())}
    assert not codes & {ca.OP_SIN, ca.OP_COS, ca.OP_TAN}
    assert found.name_out() == ["first", "second"] and found.size_out(1) == (1, 2)
    random = np.random.default_rng(3)
    for _ in range(100):
        point = random.normal(size=2), random.normal()
        for one, other in zip(found(*point), function(*point), strict=True):
            assert np.abs((one - other).full()).max() < 1e-13 * max(1.0, np.abs(other.full()).max())


@pytest.mark.parametrize(("rows", "columns", "rank"), [(3, 7, 3), (3, 3, 3), (3, 6, 2), (2, 3, 1), (2, 4, 0)])
def test_least_norm(rows, columns, rank):
    """Against the pseudoinverse, of matrices of any rank."""
    random = np.random.default_rng(rows * columns)
    left, right = (np.linalg.qr(random.normal(size=(50, n, n)))[0] for n in (rows, columns))
    A = left[:, :, :rank] * random.uniform(0.1, 2.0, (50, 1, rank)) @ right[:, :rank]
    b = (A @ random.normal(size=(50, columns, 1)))[:, :, 0]
    wanted = (np.linalg.pinv(A, rcond=1e-12) @ b[:, :, None])[:, :, 0]
    assert np.abs(least_norm(A, b) - wanted).max() < 1e-11


@pytest.mark.parametrize(("rows", "columns", "rank"), [(6, 2, 2), (4, 4, 4), (6, 3, 2), (5, 2, 1), (4, 2, 0)])
def test_least_squares(rows, columns, rank):
    """Against the pseudoinverse, of matrices of any rank."""
    random = np.random.default_rng(rows * columns + rank)
    for _ in range(50):
        left, right = (np.linalg.qr(random.normal(size=(n, n)))[0] for n in (rows, columns))
        A = left[:, :rank] * random.uniform(0.1, 2.0, rank) @ right[:, :rank].T
        b = random.normal(size=rows)
        assert np.abs(least_squares(A, b) - np.linalg.pinv(A, rcond=1e-12) @ b).max() < 1e-11


LIBM = re.compile(
    r"\b(?:np|math|cmath)\.(?:a?(?:sin|cos|tan)h?|arc\w+|atan2|exp\w*|log\w*|pow\w*"
    r"|float_power|angle|phase|rect|polar)\("
)
# What draws; the physics engine; numbers that are rounded or drawn, of which docs/sweep.md says so
NOT_IN_RUNS = (
    "simulation/(plot|drawing|film/.*|engine/.*|sweeping/.*|telemetry/.*|specification/(distributions"
    "|floor)).py"
    "|simulation/planning/(picture|smooth).py"
    "|simulation/controllers/balance/(steady|zero_dynamics).py"
)


def test_runs_need_no_libm():
    """No call of a function whose last bits depend on the processor in what runs go through;
    hypot is the same on all."""
    calls = []
    for path in (ROOT / "simulation").rglob("*.py"):
        if not re.fullmatch(NOT_IN_RUNS, name := str(path.relative_to(ROOT))):
            lines = path.read_text().splitlines()
            calls += [f"{name}:{number}: {line}" for number, line in enumerate(lines, 1) if LIBM.search(line)]
    assert calls == []
    assert (
        LIBM.search("np.cos(direction)")
        and LIBM.search("a * math.exp(b)")
        and not LIBM.search("math.sqrt(x)")
    )


def test_one_digest():
    """The CSVs of some SPECs, as on this processor and as on an old one. All SPECs,
    processors and backends: nightly."""
    assert digest_with("this processor", FEW, ["casadi"]) == digest_with(OLDEST, FEW, ["casadi"])


OTHERS = [choice for choice in choices() if choice not in ("this processor", OLDEST)]
THIRDS = [SPECS[k::3] for k in range(3)]


@pytest.mark.nightly
@pytest.mark.parametrize("backend", BACKENDS)
def test_one_digest_of_all(backend):
    """The CSVs of all SPECs on the oldest processor."""
    for third, specs in enumerate(THIRDS):
        assert digest_with(OLDEST, specs, [backend]) == digest_here(third, backend)


@pytest.mark.nightly
@pytest.mark.parametrize("choice", OTHERS)
def test_one_digest_of_some(choice):
    """The CSVs of a third of the SPECs, each third with two choices or three, by the backend that calls
    libraries most. The tests of what computes them run with each choice too."""
    if reason := lacking(choice):
        pytest.skip(reason)
    third = OTHERS.index(choice) % 3
    assert digest_with(choice, THIRDS[third], ["casadi"]) == digest_here(third, "casadi")


@cache
def digest_here(third: int, backend: str) -> str:
    return digest_with("this processor", THIRDS[third], [backend])


def test_coefficients_of_the_integrator():
    """Against SciPy's, bit for bit."""
    n = DOP853.n_stages
    ours = (*A, B, E5, E3, *WITHIN_A, *WITHIN_D)
    theirs = (*DOP853.A[1:n], DOP853.B, DOP853.E5, DOP853.E3, *DOP853.A_EXTRA, *DOP853.D)
    for row, other in zip(ours, theirs, strict=True):
        assert [row.get(k, 0.0) for k in range(len(other))] == other.tolist()
    assert list(C) == DOP853.C[1:n].tolist() and list(WITHIN_C) == DOP853.C_EXTRA.tolist()
