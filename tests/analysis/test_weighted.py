"""Mixed sensitivity: the norm against the transfer functions themselves, and what the weights promise."""

import numpy as np
import pytest
from noslip.analysis.outer.design import Gains
from noslip.analysis.outer.weighted import LOW, Weights, from_mixed, weighted_norm
from noslip.readers.errors import BadInput

OMEGA = np.geomspace(1e-4, 1e5, 40001)


def responses(gains: Gains) -> tuple[np.ndarray, np.ndarray]:
    """S and T of the polynomial of the gains over the chain of integrators, by hand."""
    s = 1j * OMEGA
    L = np.polyval(gains.vector[::-1], s) / s ** len(gains.vector)
    return 1 / (1 + L), L / (1 + L)


@pytest.mark.parametrize(
    "gains", [Gains(2, 1.0, 2.5), Gains(1, 2.0), Gains(2, 2.0, 0.2, 0.1), Gains(3, 7.0, 9.0, 0.0, (8.0,))]
)
def test_the_norm_is_that_of_the_frequency_response(gains):
    weights, s = Weights(0.8, 15.0, 1.6), 1j * OMEGA
    S, T = responses(gains)
    by_hand = (
        np.abs((s / 1.6 + 0.8) / (s + LOW * 0.8) * S) ** 2
        + np.abs((s / 15 + 1 / 1.6) / (LOW * s / 15 + 1) * T) ** 2
    )
    assert weighted_norm(gains, weights) == pytest.approx(np.sqrt(by_hand.max()), rel=1e-5)


def test_gains_that_are_not_stable_have_no_norm():
    with pytest.raises(BadInput, match="negative"):
        weighted_norm(Gains(2, 1.0, -0.1), Weights(1.0, 10.0))


@pytest.mark.parametrize(("degree", "integral"), [(1, False), (2, False), (2, True)])
def test_below_one_the_weights_are_kept(degree, integral):
    weights = Weights(1.0, 20.0, 2.0)
    gains, reached = from_mixed(degree, weights, integral)
    assert reached == weighted_norm(gains, weights) < 1 and gains.poles.real.max() <= -0.3
    assert bool(gains.integral) == integral
    S, T = (np.abs(each) for each in responses(gains))
    s = 1j * OMEGA
    assert (S <= np.abs((s + LOW) / (s / 2 + 1))).all() and (
        T <= np.abs((LOW * s / 20 + 1) / (s / 20 + 0.5))
    ).all()


def test_the_search_is_near_the_best_of_a_grid():
    """Of gains of one integrator there is one: no other is better by more than the tolerance of the
    search."""
    weights = Weights(1.0, 20.0)
    _, reached = from_mixed(1, weights)
    assert reached <= min(weighted_norm(Gains(1, kv), weights) for kv in np.geomspace(0.5, 50, 60)) * (
        1 + 1e-3
    )


def test_what_is_refused(bad_input):
    with pytest.raises(BadInput, match="no gains were found .* the norm is"):
        from_mixed(1, Weights(5.0, 6.0, 1.05))
    for weights, says in (
        (Weights(2.0, 1.0), "must be below the roll-off"),
        (Weights(1.0, 9.0, 1.0), "must be above 1"),
    ):
        with pytest.raises(BadInput, match=says):
            weights.check()
    command = ["outer-loop", "labmate", "--output", "type_i", "--mixed"]
    assert "takes the band of S, the roll-off of T and the largest peak" in bad_input([*command, "1,20"])
    assert "band = -1 must be positive" in bad_input([*command[:-1], "--mixed=-1,20,2"])
