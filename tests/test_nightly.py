"""What `make test` leaves to the night: every check keeps a test, and no pattern is idle."""

from noslip.tests.nightly import NIGHTLY, faults, is_nightly

ALL = [("test_bits", f"test_bits[{build}]") for build in ("cortex-m4f clang -O2", "x86_64 gcc -O0")]


def test_some_parameters_are_left_to_the_night():
    assert [is_nightly(*test) for test in ALL] == [True, False]
    assert not is_nightly("test_rooms", "test_bits[cortex-m4f clang -O2]")
    assert faults(ALL) == []


def test_a_pattern_that_fits_nothing_is_a_fault():
    (pattern,) = NIGHTLY["test_bits"]
    assert faults(ALL[1:]) == [f"test_bits: no test fits {pattern}"]


def test_a_check_of_which_nothing_is_left_is_a_fault():
    assert faults(ALL[:1]) == ["test_bits: no test_bits is left"]


def test_of_many_parameters_a_third_stays():
    names = [f"test_conics[{k}]" for k in range(300)]
    assert 80 < sum(not is_nightly("test_codegen", name) for name in names) < 120
    assert not any(is_nightly("test_rooms", name) for name in names)
    assert faults([("test_disturbance", "test_other")]) == ["test_disturbance: no test fits test_c_is_the_reference"]
    one = next(name for k in range(9) if is_nightly("test_disturbance", name := f"test_c_is_the_reference[{k}]"))
    assert faults([("test_disturbance", one)]) == ["test_disturbance: no test_c_is_the_reference is left"]
