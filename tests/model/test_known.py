"""What is known of expressions from another run: the same as what is found, and used."""

import casadi as ca
import pytest
from noslip.model.algebra import entries, exact
from noslip.model.algebra.known import Known, known_of
from noslip.model.law import control_law
from noslip.model.outputs import output_map
from noslip.model.reduction import reduce
from noslip.model.robots import SHIPPED

LAWS = [("labmate", "type_iv_ellipse"), ("tractor_trailer", "type_iv_line"), ("castor_platform", "type_i")]


class Texts(dict):
    """A store of other runs."""

    def read(self, key: str) -> str | None:
        return self.get(key)

    write = dict.__setitem__


@pytest.fixture
def store(monkeypatch):
    texts = Texts()
    monkeypatch.setattr(exact, "_stores", [texts])
    return texts


def law(robot: str, name: str, monkeypatch):
    """Derived without anything that this run knows already."""
    monkeypatch.setattr(exact, "_known", {})
    system = reduce(SHIPPED[robot]())
    return control_law(system, output_map(system, name))


@pytest.mark.parametrize("robot, name", LAWS)
def test_a_law_is_the_same_from_what_another_run_found(robot, name, store, monkeypatch):
    """To the last operation, and nothing is found twice."""
    first = law(robot, name, monkeypatch)
    found = dict(store)
    assert len(found) > 20
    monkeypatch.setattr(entries, "examined", None)
    again = law(robot, name, monkeypatch)
    assert store == found and again.system.mechanism is not first.system.mechanism
    for one, other in zip(*(list(each.quantities.values()) for each in (first, again)), strict=True):
        assert one.serialize() == other.serialize()


def test_entries_of_equal_magnitude_are_one_expression(store, monkeypatch):
    """Also if one is known from another run and the other is found in this one;
    the symbols of another order are others."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    ways = (x + y) ** 2, x**2 + 2 * x * y + y * y, -((x + y) ** 2), x**2 - 2 * x * y + y**2
    exact.canonical(ways[1])
    monkeypatch.setattr(exact, "_known", {})
    first, second, negative, other = ca.vertsplit(exact.canonical(ca.vertcat(*ways)))
    assert (
        ca.is_equal(first, second) and ca.is_equal(-first, negative, 1) and not ca.is_equal(first, other, 9)
    )


def test_all_of_it_is_in_the_text():
    x, y = (ca.SX.sym(name) for name in "xy")
    for known in (
        Known([x, y]),
        Known([x, y], x / y),
        Known([x, y], None, ((1, 0), "g0"), True),
        Known([x, y], x * y, ((0,), "g0"), False, ca.sin(x) * 3.3),
    ):
        read = known_of(known.text(), [x, y])
        assert (read.form, read.negative, read.key) == (known.form, known.negative, known.key)
        for one, other in ((read.rewritten, known.rewritten), (read.magnitude, known.magnitude)):
            assert (one is None) == (other is None) and (one is None or ca.is_equal(one, other, 9))
