"""Numbers with units in SPECs and on the command line, and angles that are likely to be degrees."""

import math
import subprocess
import sys

import pytest
from noslip.cli.main import main
from noslip.readers.errors import BadInput
from noslip.readers.quantities import measured
from noslip.readers.reading import angle, by_name, number, point, pose
from noslip.simulation.loop import make_loop
from noslip.simulation.specification.spec import read_text
from noslip.simulation.specification.vary import change, read_varied
from noslip.simulation.sweeping.study import sample_spec, study_of

SWEPT = """
[sweep]
[sweep.initial]
point = [{ normal = ["100 ft", "50 cm"] }, 18.0]
heading = { normal = ["90 deg", "5 deg"], within = ["60 deg", "2 rad"] }
[sweep.plant]
m_c = { uniform = ["60 lb", 35.0] }
"""


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("90 deg", "rad", math.pi / 2),
        ("-1.5e1 deg", "rad", -math.pi / 12),
        ("1/4 turn", "rad", None),
        ("0.25 turn", "rad", math.pi / 2),
        ("36 km/h", "m/s", 10.0),
        ("3 ft", "m", 0.9144),  # exact by definition of the foot
        ("1 lbf ft", "N m", 4.4482216152605 * 0.3048),
        ("1 lbf*ft", "N m", 4.4482216152605 * 0.3048),
        ("60 rpm", "rad/s", 2 * math.pi),
        ("10 Hz", "1/s", 10.0),
        ("5 1/s", "1/s", 5.0),
        ("2 g cm^2", "kg m^2", 2e-7),
        ("2 g cm**2", "kg m^2", 2e-7),
        ("9.81 m s^-2", "m/s^2", 9.81),
        ("50 percent", "1", 0.5),
    ],
)
def test_numbers_with_units_are_read_in_si(text, unit, value):
    if value is None:
        with pytest.raises(BadInput, match="is not a number"):
            number(unit=unit)(text, "x")
    else:
        assert number(unit=unit)(text, "x") == pytest.approx(value, rel=4e-16)


@pytest.mark.parametrize(
    ("text", "unit", "words"),
    [
        (
            "3 kg",
            "m",
            'x = "3 kg" has the wrong dimension, kilogram; write a number in m, or a number, a space and a '
            "unit",
        ),
        ("10 Hz", "rad/s", "wrong dimension"),  # cycles or radians per second?
        ("10 rpm", "1/s", "wrong dimension"),
        ("3 m", "1", "write a number without a unit"),
        ("3 furlogn", "m", "unknown unit 'furlogn'"),
        ("90deg", "rad", "is not a number"),
        ("1e999 m", "m", "is not finite"),
        ("1e29 km", "m", "out of range"),
        ("-3 m", "m", "must be positive"),
        ("3 degC", "K", "another zero"),
        ("3 dB", "1", "unknown unit"),
        ("3 nan", "1", "unknown unit"),
        ("9**9**9**9 m", "m", "is not a number"),
        ("1 m**9**9", "m", "is not a number"),
        ("1 m^99", "m", "is not a number"),
        ("1 __import__('os')", "m", "is not a number"),
        ("1 " + "m " * 100 + "m", "m", "is not a number"),
        ("1" * 100 + " m", "m", "is not a number"),
        ("1 " + "x" * 10_000, "m", "is not a number"),
        ("٣ m", "m", "is not a number"),  # a digit, but not an ASCII one
    ],
)
def test_what_is_not_such_a_number_is_refused(text, unit, words):
    with pytest.raises(BadInput) as raised:
        number("positive", unit)(text, "x")
    assert words in str(raised.value) and len(str(raised.value)) < 250


def test_a_plain_heading_of_more_than_a_turn_is_refused():
    with pytest.raises(BadInput) as raised:
        angle(90, "heading")
    message = (
        'heading = 90 rad is more than a turn: did you mean degrees? write "90 deg", or "90 rad" if '
        "that is meant"
    )
    assert str(raised.value) == message
    assert (
        angle("90 rad", "heading") == 90.0
        and angle(6.2832, "heading") == 6.2832
        and angle(-math.tau, "x") == -math.tau
    )
    assert pose(["1 km", 2, "180 deg"], "from") == (1000.0, 2.0, math.pi)
    with pytest.raises(BadInput, match=r"from\[2\] = 180 rad is more than a turn"):
        pose([1, 2, 180], "from")
    with pytest.raises(BadInput, match=r"at\[1\] = \"2 s\" has the wrong dimension"):
        point([1, "2 s"], "at")


CHANGES = {
    "initial.heading": ("90 deg", math.pi / 2),
    "initial.point": (["100 ft", 18.0], [30.48, 18.0]),
    "reference.speed": ("18 km/h", 5.0),
    "parameters.r": ("15 cm", 0.15),
    "plant.m_c": ("60000 g", 60.0),
    "plant.I_c": ("16 kg m^2", 16.0),
    "gains.kp": ("4 1/s^2", 4.0),
    "gains.ki": ("1 1/s^3", 1.0),
    "output.path.R": ("1000 cm", 10.0),
    "simulation.duration": ("1 min", 60.0),
    "limits.torque": (["20 N m"], [20.0]),
    "sensors.noise.sd": ("1 deg/s", math.pi / 180),
}


def test_a_spec_with_units_makes_the_same_loop_as_one_without():
    base = {"simulation.period": 0.01, "limits.integral": 0.1}
    loops = []
    for k in (0, 1):
        changes = base | {key: values[k] for key, values in CHANGES.items() if not key.startswith("gains.ki")}
        changes |= {"gains.ki_distance": CHANGES["gains.ki"][k]}
        spec = read_varied("circle", changes)
        loop = make_loop(spec)
        loops.append(
            (
                spec,
                loop.believed.tolist(),
                loop.plant.parameters.tolist(),
                loop.gains.tolist(),
                loop.start.tolist(),
            )
        )
    assert loops[0] == loops[1]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("plant.m_c", "3 m", 'plant.m_c = "3 m" has the wrong dimension'),
        ("parameters.r", "3 deg", "parameters.r"),
        ("gains.kp", "4 1/s", "gains.kp"),
        ("gains.kp_distance", "4 m", "gains.kp_distance"),
        ("output.path.R", "10 s", "output.path.R"),
        ("limits.torque", ["2 N"], "limits.torque[0]"),
        ("limits.torque", ["2 N m", "1 m"], "limits.torque[1]"),
        ("initial.point", ["2 N m", 1.0], "[initial] point[0]"),
        ("initial", {"q": [0, "2 s", 0, 0, 0]}, "initial.q[1]"),
        ("initial", {"q": [0, 0, 0, 0, 0], "nu": ["1 m/s", 0]}, "initial.nu[0]"),
        ("plant.m_w", "3 m_c", "unknown unit 'm_c'"),
        ("initial.heading", 90, "did you mean degrees?"),
        (
            "output.path",
            {"kind": "dubins", "from": [0, 0, 90], "to": [9, 9, 0], "radius": 1},
            "did you mean degrees?",
        ),
        ("sensors.counts", "3 m", "is not an integer"),
    ],
)
def test_a_wrong_unit_in_a_spec_is_refused_by_its_name(key, value, words):
    with pytest.raises(BadInput) as raised:
        make_loop(read_varied("circle", {"simulation.period": 0.01, key: value}))
    assert words in str(raised.value)


def test_coordinates_may_be_larger_than_a_turn():
    make_loop(read_varied("circle", {"initial": {"q": [30.0, 15.0, 1.5, 90.0, -90.0], "nu": [1.0, 1.0]}}))


def test_set_takes_a_unit_with_and_without_the_quotes_of_toml():
    assert (
        change('initial.heading="90 deg"')
        == change("initial.heading=90 deg")
        == ("initial.heading", "90 deg")
    )
    with pytest.raises(BadInput):
        change("initial.heading=90 deg;")


def test_distributions_have_units():
    study = study_of(read_text("circle") + SWEPT, "circle", 4)
    margins = study.plan.margins
    assert (
        margins["initial.heading"].a == pytest.approx(math.pi / 2)
        and margins["initial.heading"].within[1] == 2.0
    )
    assert margins["initial.point[0]"].a == pytest.approx(30.48)
    assert margins["plant.m_c"].a == pytest.approx(60 * 0.45359237)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"60 lb"', '"60 ft"', "sweep.plant.m_c"),
        ('"100 ft"', '"100 lb"', "sweep.initial.point[0]"),
        ('["90 deg", "5 deg"], within = ["60 deg", "2 rad"]', "[90, 5]", "did you mean degrees?"),
        ("[sweep]", '[sweep]\nband = "3 m"', "sweep.band"),
    ],
)
def test_a_wrong_unit_of_a_distribution_is_refused(old, new, words):
    with pytest.raises(BadInput) as raised:
        study_of(read_text("circle") + SWEPT.replace(old, new), "circle", 4)
    assert words in str(raised.value)


def test_a_sample_with_a_heading_beyond_a_turn_can_be_repeated():
    text = read_text("circle") + '[sweep.initial]\nheading = { uniform = ["360 deg", "720 deg"] }\n'
    study = study_of(text, "circle", 2)
    table = study.plan.table(0, 1)
    row = {name: float(value[0]) for name, value in study.plan.columns(table).items()}
    changes = dict(map(change, study.plan.changes(row)))
    heading = sample_spec(text, row).initial.heading
    assert heading > math.tau and read_varied("circle", changes).initial.heading == heading


def test_plan_takes_units(capsys, bad_input):
    plan = ["plan", "dubins", "--radius", "1 m", "--from", "0", "0", "0", "--to"]
    printed = []
    for goal in (["4", "3", "-1.5707963267948966"], ["400 cm", "3 m", "-90 deg"]):
        assert main([*plan, *goal]) == 0
        printed.append(capsys.readouterr().out)
    for goal in (["4", "3", "-90"], ["4", "3", "-90 deg"]):
        assert main([*plan, *goal, "--degrees"]) == 0
        printed.append(capsys.readouterr().out)
    assert len(set(printed)) == 1
    assert "did you mean degrees?" in bad_input([*plan, "4", "3", "90"])
    assert "has the wrong dimension" in bad_input([*plan, "4", "3 kg", "1"])
    assert "has the wrong dimension" in bad_input(
        ["plan", "dubins", *plan[4:], "4", "3", "1", "--radius", "3 s"]
    )
    assert "has the wrong dimension" in bad_input(
        ["outer-loop", "labmate", "--output", "type_iv_line", "--speed", "3 kg"]
    )


def test_pint_is_imported_only_for_a_unit():
    code = (
        "import sys; from noslip.simulation.specification.spec import read_spec; read_spec('line'); "
        "print('pint' in sys.modules)"
    )
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        == "False\n"
    )


def test_a_robots_unit_that_is_not_si_takes_plain_numbers_only():
    from noslip.readers.quantities import check_unit

    for unit in ("mm", "wheels", ""):
        with pytest.raises(BadInput):
            check_unit(measured("3 m", "x"), unit, "x")
    check_unit(3.0, "mm", "x")


def test_numbers_by_name():
    """Without a unit, unless the option has one; each name once."""
    assert by_name("--lqr", ["pitch=10", "a=b=0.5"], "NAME=NUMBER") == {"pitch": 10.0, "a=b": 0.5}
    assert by_name("--radius", ["left=5cm"], "LINK=METRES", number("positive", "m")) == {"left": 0.05}
    for texts, said in (
        (["pitch"], "--lqr pitch: give NAME=NUMBER"),
        (["pitch=10 kg"], "--lqr pitch = .* has the wrong dimension"),
        (["pitch=nan"], "--lqr pitch = nan is not finite"),
        (["pitch=1", "pitch=2"], "pitch has a number already"),
    ):
        with pytest.raises(BadInput, match=said):
            by_name("--lqr", texts, "NAME=NUMBER")
