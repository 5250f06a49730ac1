"""Design and linear analysis of the outer loop's channels: against closed forms, python-control,
and brute force."""

import math

import control
import mpmath
import numpy as np
import pytest
from noslip.analysis.outer.channel import Channel, Required, longest_period, longest_period_with
from noslip.analysis.outer.design import (
    Gains,
    from_discrete_poles,
    from_hinf,
    from_lqr,
    from_poles,
    from_settling,
    settling_time,
)
from noslip.analysis.outer.exponential import exponential
from noslip.analysis.outer.margins import margins, structured
from noslip.readers.errors import BadInput
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

PAPER, SPEED = Gains(2, 1.0, 2.5), Gains(1, 2.0)
INTEGRAL, SPEED_INTEGRAL = Gains(2, 1.0, 2.5, 0.3), Gains(1, 2.0, 0.0, 0.5)
ALL = (PAPER, SPEED, INTEGRAL, SPEED_INTEGRAL)
NAN, INF = math.nan, math.inf

each_channel = pytest.mark.parametrize("gains", ALL, ids=["pd", "p", "pid", "pi"])
with_delay = pytest.mark.parametrize("delay", [False, True], ids=["prompt", "late"])


def held(gains: Gains, period: float, delay: bool) -> np.ndarray:
    """The channel's map over a period, from the matrix exponential;
    the integral sums the errors at the calls."""
    degree = gains.degree
    chain = np.zeros((degree + 1, degree + 1))
    chain[:-1, 1:] = np.eye(degree)
    move = expm(chain * period)  # of y, ydot with the held v as the last entry
    size = degree + bool(gains.integral) + delay
    answer = np.zeros(size)
    answer[:degree] = [-gains.error, -gains.rate][:degree]
    if gains.integral:
        answer[degree] = gains.integral
    whole = np.zeros((size, size))
    whole[:degree, :degree] = move[:degree, :degree]
    if gains.integral:
        whole[degree, degree], whole[degree, 0] = 1.0, -period
    if delay:
        whole[:degree, -1] = move[:degree, -1]
        whole[-1] = answer
    else:
        whole[:degree] += np.outer(move[:degree, -1], answer)
    return whole


def random_gains(seed: int) -> Gains:
    random = np.random.default_rng(seed)
    degree, integral = random.integers(1, 3), bool(random.integers(2))
    return from_poles(degree, -random.uniform(0.3, 5, degree + integral), integral)


# -- design --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_poles_are_where_they_were_asked_for(seed):
    random = np.random.default_rng(seed)
    degree, integral = int(random.integers(1, 3)), bool(random.integers(2))
    count = degree + integral
    pair = complex(-random.uniform(0.1, 3), random.uniform(0.1, 3))
    poles = ([pair, pair.conjugate()] if count > 1 else []) + [-random.uniform(0.1, 3)] * (count % 2)
    gains = from_poles(degree, poles, integral)
    matrix = np.zeros((count, count))  # of the error's integral, the error and its rate, written out
    matrix[:-1, 1:] = np.eye(count - 1)
    matrix[-1] = -np.array([*([gains.integral] if integral else []), *[gains.error, gains.rate][:degree]])
    for pole in poles:
        assert np.abs(np.linalg.eigvals(matrix) - pole).min() < 1e-6
    assert np.abs(np.sort_complex(gains.poles) - np.sort_complex(poles)).max() < 1e-6


def test_paper_gains():
    assert from_poles(2, [-0.5, -2]) == PAPER and from_poles(1, [-2]) == SPEED
    assert PAPER.named("distance") == {"kp_distance": 1.0, "kd_distance": 2.5}
    assert SPEED_INTEGRAL.named("speed") == {"kv_speed": 2.0, "ki_speed": 0.5}


def test_settling_in_closed_form():
    """Critically damped (1 + w t) exp(-w t) = 0.02; one pole exp(-k t) = 0.02;
    overdamped by the two exponentials."""
    reached = float(mpmath.findroot(lambda x: (1 + x) * mpmath.exp(-x) - 0.02, 5.8))
    gains = from_settling(2, 4.0)
    assert gains.error == pytest.approx((reached / 4) ** 2, rel=1e-11) and gains.rate == pytest.approx(
        2 * reached / 4, rel=1e-11
    )
    assert from_settling(1, 4.0).error == pytest.approx(math.log(50) / 4, rel=1e-12)
    slow, fast = 0.5, 2.0

    def left(t: float) -> float:
        return (fast * math.exp(-slow * t) - slow * math.exp(-fast * t)) / (fast - slow) - 0.02

    overdamped = brentq(left, 5, 20, xtol=1e-13)
    assert settling_time(PAPER) == pytest.approx(overdamped, rel=1e-12)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("integral", [False, True])
@pytest.mark.parametrize("damping", [0.3, 0.6, 1.0, 1.25, 3.0])
def test_settles_when_it_shall(degree, integral, damping):
    """The error, integrated: 2 % at the time asked for, and within from then on."""
    gains = from_settling(degree, 3.0, damping, integral)

    def rate(t: float, x: np.ndarray) -> list[float]:
        z, e, e_rate = x
        v = -gains.integral * z - gains.error * e
        return [e, v, 0.0] if degree == 1 else [e, e_rate, v - gains.rate * e_rate]

    solution = solve_ivp(
        rate, (0, 9), [0, 1, 0], "DOP853", rtol=1e-11, atol=1e-13, t_eval=np.linspace(0, 9, 3001)
    )
    error, after = np.abs(solution.y[1]), solution.t >= 3.0
    assert error[1000] == pytest.approx(0.02, abs=1e-8) and error[after].max() <= 0.02 + 1e-8
    if degree == 2 and damping >= 1 and not integral:
        assert solution.y[1].min() > 0  # no overshoot beside a wall


def test_lqr_in_closed_form():
    """Double integrator: kp = v/e, kd^2 = v^2/r^2 + 2 v/e; a single one: kv = v/e."""
    e, r, v = 0.1, 0.2, 0.5
    gains = from_lqr(2, [e, r, v])
    assert gains.error == pytest.approx(v / e, rel=1e-10)
    assert gains.rate == pytest.approx(math.sqrt(v**2 / r**2 + 2 * v / e), rel=1e-10)
    assert from_lqr(1, [e, v]).error == pytest.approx(v / e, rel=1e-10)


@pytest.mark.parametrize("degree", [1, 2])
def test_lqr_is_python_controls(degree):
    largest = [0.1, 0.2][:degree] + [0.3, 0.5]
    A, B = np.eye(degree + 1, k=1), np.eye(degree + 1)[:, -1:]
    Q = np.diag([1 / 0.3**2, 1 / 0.1**2, 1 / 0.2**2][: degree + 1])
    K = control.lqr(A, B, Q, [[4.0]], method="scipy")[0][0]
    gains = from_lqr(degree, largest, integral=True)
    assert gains.vector == pytest.approx(K, rel=1e-9)
    sampled = control.c2d(control.ss(A[1:, 1:], B[1:], np.eye(degree), 0), 0.1)
    discrete = control.dlqr(sampled.A, sampled.B, Q[1:, 1:], [[4.0]], method="scipy")[0][0]
    assert from_lqr(degree, [*largest[:degree], 0.5], period=0.1).vector == pytest.approx(discrete, rel=1e-9)


def hamiltonian_norm(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> float:
    """The H-infinity norm of a stable system without feedthrough: the least gamma for which the Hamiltonian
    matrix has no eigenvalue on the imaginary axis (Boyd, Balakrishnan, Kabamba 1989), by bisection: no
    frequencies are tried."""
    low, high = 0.0, 1e3
    while high - low > 1e-9 * high:
        gamma = (low + high) / 2
        matrix = np.block([[A, B @ B.T / gamma**2], [-C.T @ C, -A.T]])
        values = np.linalg.eigvals(matrix)
        crosses = (np.abs(values.real) < 1e-8 * np.abs(values).max()).any()
        low, high = (gamma, high) if crosses else (low, gamma)
    return high


def weighed(
    gains: Gains, largest: list[float], period: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C from a disturbance to everything relative to its largest value, written out;
    z sums the errors at the calls."""
    degree, integral = gains.degree, bool(gains.integral)
    size, K = degree + integral, gains.vector[None, :]
    A, B = np.eye(size, k=1), np.eye(size)[:, -1:]
    if period:
        moved = expm(period * np.block([[A, B], [np.zeros((1, size + 1))]]))
        A, B = moved[:size, :size], moved[:size, size:]
        if integral:
            A[0], B[0] = [1.0, period] + [0.0] * (degree - 1), 0.0
    of_chain = [*largest[degree : degree + integral], *largest[:degree]]
    return A - B @ K, largest[-1] * B, np.vstack([np.diag(1 / np.array(of_chain)), -K / largest[-2]])


@pytest.mark.parametrize("degree", [1, 2, 4])
@pytest.mark.parametrize("integral", [False, True])
@pytest.mark.parametrize("period", [None, 0.02])
def test_hinf_keeps_all_within_their_values(degree, integral, period):
    """The norm is below 1, as the channel computes it, by a Hamiltonian matrix or by 40 000 frequencies."""
    largest = [*[0.1, 0.2, 0.5, 1.5][:degree], *[0.1] * integral, 0.5, 0.35]
    gains = from_hinf(degree, largest, integral, period)
    found = Channel("y", "m", gains, period).norm(largest)
    assert 0.7 - 1e-9 <= found < 1  # v itself must compensate a steady disturbance: 0.35 / 0.5
    A, B, C = weighed(gains, largest, period)
    if period is None:
        assert found == pytest.approx(hamiltonian_norm(A, B, C), rel=1e-7)
    omega = np.append(0.0, np.geomspace(1e-4, math.pi / (period or 0.01), 40_000))
    at = np.exp(1j * omega * period) if period else 1j * omega
    tried = np.linalg.norm(
        C @ np.linalg.solve(at[:, None, None] * np.eye(len(A)) - A, B), 2, axis=(1, 2)
    ).max()
    assert found == pytest.approx(tried, rel=1e-6)


def test_hinf_of_one_integrator_in_closed_form():
    """kv = v^2 / (e sqrt(v^2 - d^2)); the norm is largest at rest, |d| sqrt(1 / (kv e)^2 + 1 / v^2)."""
    e, v, d = 0.2, 0.5, 0.3
    gains = from_hinf(1, [e, v, d])
    assert gains.error == pytest.approx(v**2 / (e * math.sqrt(v**2 - d**2)), rel=1e-10)
    expected = d * math.hypot(1 / (gains.error * e), 1 / v)
    assert Channel("y", "m", gains).norm([e, v, d]) == pytest.approx(expected, rel=1e-9)


def test_hinf_does_what_lqr_does_not():
    """Near the largest disturbance that v can compensate, a regulator by the same values leaves one of
    them."""
    largest = [0.1, 0.2, 0.5]
    lqr, hinf = from_lqr(2, largest), from_hinf(2, [*largest, 0.48])
    assert Channel("y", "m", lqr).norm([*largest, 0.48]) > 1.3
    assert Channel("y", "m", hinf).norm([*largest, 0.48]) < 1


def test_hinf_without_disturbance_is_lqr():
    largest = [0.1, 0.2, 0.3, 0.5]
    for period in (None, 0.05):
        found = from_hinf(2, [*largest, 1e-9], True, period)
        assert found.vector == pytest.approx(from_lqr(2, largest, True, period).vector, rel=1e-12)


@pytest.mark.nightly
def test_hinf_ends_where_no_gain_can_do_it():
    """One integrator called every 0.2 s: over all gains kv the least norm is 1 at the disturbance that the
    message names."""
    e, v, period = 0.1, 0.5, 0.2
    with pytest.raises(BadInput, match=r"only below 0\.\d+") as refused:
        from_hinf(1, [e, v, 0.499], period=period)
    bearable = float(str(refused.value).split("only below ")[1].split(";")[0])
    tried = np.linspace(0.1, 9.9, 981)
    norms = [Channel("y", "m", Gains(1, gain), period).norm([e, v, bearable]) for gain in tried]
    assert min(norms) == pytest.approx(1, abs=2e-3)
    good = from_hinf(1, [e, v, 0.999 * bearable], period=period)
    assert Channel("y", "m", good, period).norm([e, v, 0.999 * bearable]) < 1


def test_hinf_against_slicot():
    """python-control's linfnorm of the closed loop."""
    pytest.importorskip("slycot")
    largest = [0.1, 0.2, 0.5, 0.35]
    for period in (None, 0.02):
        gains = from_hinf(2, largest, period=period)
        system = control.ss(*weighed(gains, largest, period), 0, period or 0)
        assert Channel("y", "m", gains, period).norm(largest) == pytest.approx(
            control.linfnorm(system)[0], rel=1e-7
        )


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("integral", [False, True])
def test_discrete_poles(degree, integral):
    poles = [0.9, 0.8, 0.95][: degree + integral]
    gains = from_discrete_poles(degree, poles, 0.1, integral)
    assert np.sort(np.linalg.eigvals(held(gains, 0.1, False)).real) == pytest.approx(sorted(poles), abs=1e-7)
    assert np.sort(Channel("y", "m", gains, 0.1).poles.real) == pytest.approx(sorted(poles), abs=1e-7)


@pytest.mark.parametrize("degree", [3, 4, 6])
def test_longer_chains(degree):
    """Poles against the polynomial written out; the sampled chain and both regulators against
    python-control's."""
    poles = [-1 - 0.3 * k for k in range(degree)]
    gains = from_poles(degree, poles)
    assert [*gains.of_errors, 1.0] == pytest.approx(np.poly(poles)[::-1], rel=1e-12)
    assert list(gains.named("y")) == [f"{name}_y" for name in ("kp", "kd", "ka", "kj", "ks", "kc")[:degree]]
    assert np.sort(gains.faster(2.0).poles.real) == pytest.approx(sorted(2 * np.array(poles)), rel=1e-6)
    A, B, largest = (
        np.eye(degree, k=1),
        np.eye(degree)[:, -1:],
        [0.1, 0.2, 0.3, 0.4, 0.5, 0.6][:degree] + [0.7],
    )
    Q, R = np.diag(1 / np.square(largest[:-1])), [[1 / 0.7**2]]
    sampled = control.c2d(control.ss(A, B, np.eye(degree), 0), 0.1)
    for answer, expected in (
        (from_lqr(degree, largest), control.lqr(A, B, Q, R, method="scipy")[0][0]),
        (
            from_lqr(degree, largest, period=0.1),
            control.dlqr(sampled.A, sampled.B, Q, R, method="scipy")[0][0],
        ),
    ):
        assert answer.vector == pytest.approx(expected, rel=1e-8)
    discrete = [0.8 + 0.02 * k for k in range(degree)]
    closed = Channel("y", "m", from_discrete_poles(degree, discrete, 0.1), 0.1)
    assert np.sort(closed.poles.real) == pytest.approx(discrete, abs=1e-3 if degree == 6 else 1e-5)
    limit = closed.longest_period(True)
    late = [
        np.abs(Channel("y", "m", closed.gains, T, True).poles).max() for T in (0.999 * limit, 1.001 * limit)
    ]
    assert late[0] < 1 < late[1]


def test_deadbeat():
    assert from_discrete_poles(2, [0, 0], 0.1) == Gains(2, pytest.approx(100.0), pytest.approx(15.0))


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: from_poles(2, [1, -2]), "pole at 1 1/s is unstable"),
        (lambda: from_poles(2, [0, -2]), "pole at 0 1/s is unstable"),
        (lambda: from_poles(2, [-1, -2, -3]), "improper"),
        (lambda: from_poles(1, [-1, -2, -3], True), "improper"),
        (lambda: from_poles(2, [-1]), "1 poles for a channel that has 2"),
        (lambda: from_poles(2, [-1 + 1j, -2]), "conjugate"),
        (lambda: from_poles(2, [NAN, -1]), "not finite"),
        (lambda: from_poles(2, ["a", -1]), "not numbers"),
        (lambda: from_poles(7, [-1] * 7), "relative degree 7"),
        (lambda: from_settling(2, 0.0), "must be positive"),
        (lambda: from_settling(2, -1.0), "must be positive"),
        (lambda: from_settling(2, 1.0, NAN), "is not finite"),
        (lambda: from_settling(2, "1"), "is not a number"),
        (lambda: from_lqr(2, [1, 1]), "LQR requires 3"),
        (lambda: from_lqr(2, [1, 0, 1]), "largest rate = 0"),
        (lambda: from_lqr(2, [1, 1, 1], period=0.0), "period = 0"),
        (lambda: from_discrete_poles(2, [1.0, 0.5], 0.1), "unstable"),
        (lambda: from_discrete_poles(2, [0.5, 0.5], 0.0), "period = 0"),
        (lambda: Gains(2, -1.0, 2.0).check(), "negative"),
        (lambda: Gains(2, 1.0, 0.0).check("d"), "d: unstable"),
        (lambda: Gains(2, 1.0, 1.0, 2.0).check(), "unstable, it has a pole at"),
        (lambda: Gains(1, NAN).check(), "not finite"),
        (lambda: Channel("y", "m", PAPER, 0.0), "period = 0"),
        (lambda: Channel("y", "m", PAPER, delay=True), "requires a period"),
        (lambda: Channel("y", "m", PAPER, 0.81).margins(), "stable below 0.8 s"),
        (
            lambda: Channel("y", "m", PAPER, 0.37, True).margins(),
            "with a delay of one sample, is beyond stability",
        ),
    ],
)
def test_refused(make, reason):
    with pytest.raises(BadInput) as refused:
        make()
    assert reason in str(refused.value)


@pytest.mark.parametrize("size", [1, 3, 8])
@pytest.mark.parametrize("norm", [0.0, 1e-3, 1.0, 40.0])
def test_exponential(size, norm):
    matrix = np.random.default_rng(size).normal(size=(size, size))
    matrix *= norm / np.linalg.norm(matrix)
    assert (
        np.abs(exponential(matrix) - expm(matrix)).max()
        <= 1e-13 * max(1.0, norm) * np.abs(expm(matrix)).max()
    )


# -- sampled channels ----------------------------------------------------------------------------------------


@each_channel
@with_delay
def test_discrete_model(gains, delay):
    """Poles, and the plant as python-control samples it."""
    channel = Channel("y", "m", gains, 0.13, delay)
    expected = np.linalg.eigvals(held(gains, 0.13, delay))
    assert np.abs(np.sort_complex(channel.poles) - np.sort_complex(expected)).max() < 1e-7
    sampled = control.c2d(Channel("y", "m", gains).plant(), 0.13)
    assert (
        np.abs(channel.plant().A - sampled.A).max() < 1e-12
        and np.abs(channel.plant().B - sampled.B).max() < 1e-12
    )
    assert channel.plant().output_labels == ["y", "y_rate"][
        : gains.degree
    ] and channel.plant().input_labels == ["v_y"]


def test_longest_period_in_closed_form():
    """Double integrator: min(2/kd, 2 kd/kp); single: 2/kv; with a sample's delay z^2 - z + kv T: 1/kv."""
    for kp, kd in ((1.0, 2.5), (4.0, 5.0), (9.0, 0.5)):
        assert longest_period(Gains(2, kp, kd)) == pytest.approx(min(2 / kd, 2 * kd / kp), rel=1e-12)
    assert longest_period(SPEED) == pytest.approx(1.0, rel=1e-12)
    assert longest_period(SPEED, delay=True) == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("seed", range(12))
@with_delay
def test_longest_period(seed, delay):
    """On the unit circle at that period, inside at every shorter one:
    eigenvalues of the matrix exponential's map."""
    gains = random_gains(seed)
    limit = longest_period(gains, delay)
    radius = [
        np.abs(np.linalg.eigvals(held(gains, part * limit, delay))).max()
        for part in np.linspace(0.01, 0.99, 99)
    ]
    assert max(radius) < 1
    at, beyond = (np.abs(np.linalg.eigvals(held(gains, part * limit, delay))).max() for part in (1, 1.01))
    assert at == pytest.approx(1, abs=1e-7) and beyond > 1


def test_longest_period_with_margins():
    """A gain margin of 2 with the held double integrator: the gain may double until kd T = 1, kp T = kd."""
    none = {"phase": 1e-3, "Ms": 1e3}
    channel = Channel("y", "m", PAPER)
    assert longest_period_with(channel, Required(gain=2.0, **none)) == pytest.approx(0.4, rel=1e-9)
    phase = longest_period_with(channel, Required(gain=1.001, phase=math.radians(60), Ms=1e3))
    assert Channel("y", "m", PAPER, phase).margins().phase == pytest.approx(math.radians(60), abs=1e-9)
    peak = longest_period_with(channel, Required(gain=1.001, phase=1e-3, Ms=1.5))
    assert Channel("y", "m", PAPER, peak).margins().Ms == pytest.approx(1.5, abs=1e-8)
    # Not even in continuous time
    assert longest_period_with(channel, Required(gain=2.0, phase=math.radians(89))) == 0


# -- margins -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("sampled", [False, True])
def test_margins_are_python_controls(seed, sampled):
    gains = random_gains(seed)
    period = 0.2 * longest_period(gains) if sampled else None
    loop = Channel("y", "m", gains, period).loop()
    ours = margins(loop)
    omega = np.geomspace(1e-3, np.pi / period if sampled else 1e3, 4000)
    response = loop(np.exp(1j * omega * period) if sampled else 1j * omega)
    data = control.frd(response, omega)
    gain, phase, _, _, crossover, _ = control.stability_margins(data)
    assert ours.phase == pytest.approx(math.radians(phase), abs=1e-4) and ours.crossover == pytest.approx(
        crossover, rel=1e-4
    )
    if gain < 1:  # the margin that python-control finds nearest; ours are both
        assert ours.gain_down == pytest.approx(gain, rel=1e-4)
    S = 1 / (1 + response)
    assert ours.Ms == pytest.approx(max(1.0, np.abs(S).max()) if not sampled else np.abs(S).max(), abs=1e-5)
    assert ours.Mt == pytest.approx(np.abs(1 - S).max(), abs=1e-5)
    disk, disk_gain, disk_phase = control.disk_margins(loop, omega[::10])
    assert ours.disk <= disk + 1e-12 and ours.disk == pytest.approx(disk, abs=1e-3)
    if disk < 1.999:
        assert ours.disk_phase == pytest.approx(math.radians(disk_phase), abs=1e-3)
        assert 20 * math.log10(ours.disk_gain) == pytest.approx(disk_gain, abs=0.05)


@each_channel
@with_delay
def test_gain_margins_are_the_limits_of_stability(gains, delay):
    """At the factors found the closed loop has a pole on the unit circle;
    a delay of the margin's size uses the phase up."""
    channel = Channel("y", "m", gains, 0.05, delay)
    ours, loop = channel.margins(), channel.loop()

    def radius(factor: float) -> float:
        return float(np.abs(np.linalg.eigvals(loop.A - factor * loop.B @ loop.C)).max())

    assert radius(ours.gain) == pytest.approx(1, abs=1e-7) and radius(0.999 * ours.gain) < 1 < radius(
        1.001 * ours.gain
    )
    if ours.gain_down:
        assert radius(ours.gain_down) == pytest.approx(1, abs=1e-7) and radius(0.999 * ours.gain_down) > 1
    L = complex(loop(np.exp(1j * ours.crossover * 0.05)))
    assert L * np.exp(-1j * ours.crossover * ours.delay) == pytest.approx(-1, abs=1e-7)


@pytest.mark.parametrize("seed", range(10))
def test_structured_singular_value(seed):
    """Two factors: the least scaled singular value is also the largest spectral radius over their phases."""
    random = np.random.default_rng(seed)
    M = random.normal(size=(1, 2, 2)) + 1j * random.normal(size=(1, 2, 2))
    turned = [np.diag([1, np.exp(1j * angle)]) @ M[0] for angle in np.linspace(0, 2 * np.pi, 20_001)]
    assert structured(M)[0] == pytest.approx(np.abs(np.linalg.eigvals(turned)).max(), rel=1e-6)


@pytest.mark.parametrize("size", [3, 4, 6])
def test_structured_singular_value_of_products_in_closed_form(size):
    """M = a b* has the structured singular value sum |a_i b_i|,
    a diagonal matrix its largest entry. Bounds, and close ones."""
    random = np.random.default_rng(size)
    a, b = (random.normal(size=(40, size)) + 1j * random.normal(size=(40, size)) for _ in range(2))
    a *= 10 ** random.uniform(-1, 1, (40, size))
    found, exact = structured(a[:, :, None] * b[:, None, :].conj()), np.abs(a * b).sum(axis=1)
    assert (found >= exact * (1 - 1e-12)).all() and (found <= 1.03 * exact).all()
    diagonal = np.array([np.diag(row) for row in a])
    assert structured(diagonal) == pytest.approx(np.abs(a).max(axis=1), rel=1e-12)


def test_structured_singular_value_is_reached_for_three():
    """Some unitary diagonal U makes rho(U M) as large, with three places:
    found by a search over two angles."""
    random = np.random.default_rng(8)
    angles = np.exp(1j * np.linspace(0, 2 * np.pi, 121))
    for _ in range(5):
        matrix = (random.normal(size=(3, 3)) + 1j * random.normal(size=(3, 3))) * np.exp(
            random.normal(size=(3, 1))
        )
        turned = np.array([matrix * np.array([[1], [s], [t]]) for s in angles for t in angles])
        reached = np.abs(np.linalg.eigvals(turned)).max()
        found = structured(matrix[None])[0]
        assert reached <= found * (1 + 1e-12) and found <= 1.05 * reached < 1.05 * np.linalg.norm(matrix, 2)


def test_disk_margin_of_two_loops_side_by_side():
    """Without coupling, that of the worse one: what slycot would be needed for in python-control."""
    first, second = (Channel("y", "m", gains, 0.1).loop() for gains in (PAPER, SPEED))
    both = margins(control.append(first, second))
    assert both.disk == pytest.approx(min(margins(first).disk, margins(second).disk), rel=1e-6)
    assert both.Ms == pytest.approx(max(margins(first).Ms, margins(second).Ms), rel=1e-6) and math.isnan(
        both.gain
    )


@each_channel
@pytest.mark.parametrize("period", [None, 0.05])
def test_step_response(gains, period):
    """Ends at 1; follows the differential equation, or the map, from the matrix exponential."""
    channel = Channel("y", "m", gains, period)
    times = np.linspace(0, 40, 4001) if period is None else 0.05 * np.arange(801)
    y, v = control.step_response(channel.closed(), times, squeeze=False).outputs[[0, -1], 0]
    assert abs(y[-1] - 1) < 0.001 and v[0] == pytest.approx(gains.error)
    if period:
        whole, state = held(gains, period, False), np.zeros(gains.degree + bool(gains.integral))
        state[0] = -1.0  # from where y = 1 is at rest
        for value in y[:200]:
            assert value == pytest.approx(1 + state[0], abs=1e-10)
            state = whole @ state
