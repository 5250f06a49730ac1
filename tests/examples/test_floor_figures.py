"""The figures on a floor: which claims survive there, and what is said without the engine."""

import dataclasses

import numpy as np
import pytest
from noslip.examples.evidence import catalogue
from noslip.examples.evidence.figures import floor, line
from noslip.examples.evidence.framework import carry_out, claims_of_every_run
from noslip.examples.evidence.production import Made
from noslip.examples.evidence.report import as_json, report
from noslip.readers.errors import BadInput
from noslip.simulation.drawing import pictures, plotted
from noslip.tests.figures_made import figure_of
from noslip.tests.simulation.test_engine import ROBOTS

pytest.importorskip("mujoco")
NAMES = [figure.name for figure in floor.FIGURES]
SPEEDS = line.FIGURES[2]  # figure 7
FLOORS = {(0.7, floor.BARE): 0, (0.7, floor.LIMITED): 2, (0.7, floor.LED): 1}


@pytest.fixture(scope="module")
def runs():
    """Figure 7 rolling, 10 s, and on a floor, its first 4 s."""
    made = {}
    for on in (floor.ROLLING, *FLOORS):
        for label, case in SPEEDS.cases.items():
            case = floor._on_floor(case, on, share=0.7)
            shorter = {} if on == floor.ROLLING else {"simulation.duration": 4.0}
            case = dataclasses.replace(case, changes={**case.changes, **shorter})
            made[floor._label(SPEEDS, label, on)] = carry_out(case.spec(), engine=case.engine)
    return made


@pytest.mark.nightly
def test_the_table_is_made_from_runs(runs, monkeypatch):
    """A claim is one that holds where the wheels roll, is lost where its run ended,
    and else is judged as in its own figure."""
    monkeypatch.setattr(floor, "PAPERS", (SPEEDS,))
    monkeypatch.setattr(floor, "SURVIVE", FLOORS)
    monkeypatch.setattr(floor, "SHOWN", "IV")
    table = floor.survivors(runs)
    assert len(table) == 4
    rolling, bare, limited, led = (
        [by_floor[each] for by_floor in table.values()] for each in (floor.ROLLING, *FLOORS)
    )
    assert all(holds for holds, _ in rolling)
    assert not any(holds for holds, _ in bare)
    ends = [said.partition(": ")[2] for _, said in bare]
    assert all(end.startswith(("range at 0.0", "overturned at 0.0")) for end in ends)
    assert [holds for holds, _ in limited] == [True, False, False, True]  # at 4 s it is still 2 cm/s too slow
    own = SPEEDS.claims(
        {label: runs[floor._label(SPEEDS, label, (0.7, floor.LED))] for label in SPEEDS.cases}
    )
    assert led == [(claim.holds, claim.measured) for claim in own if claim.paper]
    *_, rolls = floor.claims_papers(runs)
    assert [claim.holds for claim in floor.claims_papers(runs)] == [True] * 4
    slides = {label: dataclasses.replace(run, floor=run.floor and slid(run)) for label, run in runs.items()}
    assert rolls.holds and not floor.claims_papers(slides)[-1].holds
    standing = {
        label: runs[floor._label(SPEEDS, "IV", floor.ROLLING)] if not run.floor else run
        for label, run in runs.items()
    }
    assert len(floor.survivors(standing)) < 4  # what does not hold where the wheels roll is not in the table
    data = plotted(floor.draw_papers(runs))
    for on, by_floor in zip((floor.ROLLING, *FLOORS), (rolling, bare, limited, led), strict=True):
        assert data.count(f"; {floor._said(on)}: holds") == sum(holds for holds, _ in by_floor)


def slid(run):
    return dataclasses.replace(run.floor, slip=run.floor.slip + 0.02)


@pytest.mark.nightly
def test_runs_on_a_floor_in_the_report(runs):
    """They have no column of what only rolling has, and no claims of every run."""
    there = {label: run for label, run in runs.items() if run.floor}
    assert claims_of_every_run(there) == [] and len(claims_of_every_run(runs)) == 3
    cases = {label: dataclasses.replace(floor.PAPER_CASES[label], changes={}) for label in there}
    figure = dataclasses.replace(floor.FIGURES[0], cases=cases)
    made = Made(figure, there, [], {"svg": b"<svg/>", "png": b""})
    assert report([made]).count('<td class="number">–</td>' * 4) == len(there)
    (said,) = as_json([made])
    bare, limited, led = (
        [one["slipping"] for k, one in said["runs"].items() if k.endswith(f", {limits}")]
        for _, limits in FLOORS
    )
    assert min(bare) > 100 and 0 < max(*limited, *led) < 0.01


def test_the_robots_are_those_that_the_engine_takes():
    assert sorted(floor.ROBOTS) == sorted(ROBOTS)
    assert len(floor.ROBOT_CASES) == len(floor.ROBOTS) * len(floor.FLOORS_OF_ROBOTS)


def test_without_the_engine_they_are_left_out(monkeypatch, capsys):
    assert catalogue.left_out() == [] and {*NAMES} < {
        figure.name for figure in catalogue.chosen([], every=True)
    }
    assert not {*NAMES} & {figure.name for figure in catalogue.chosen([])} and "fastest" in [
        f.name for f in catalogue.chosen([])
    ]
    monkeypatch.setattr(catalogue, "find_spec", lambda name: None)
    assert catalogue.left_out() == NAMES and not {*NAMES} & {
        figure.name for figure in catalogue.chosen([], every=True)
    }
    with pytest.raises(
        BadInput, match=r"--only: figure 'floor' is made in a physics engine; `make -C .* setup` installs it"
    ):
        catalogue.chosen(["6", "floor"])


def test_reckoning_is_off_by_what_it_says(runs):
    run = runs[floor._label(SPEEDS, "I", (0.7, floor.LIMITED))]
    assert floor.reckoning_error(run) < 1e-2
    moved = dataclasses.replace(
        run, floor=dataclasses.replace(run.floor, reckoned=run.floor.reckoned + [3.0, 4.0, 0.0])
    )
    assert floor.reckoning_error(moved) == pytest.approx(5.0, abs=1e-2)
    assert floor.reckoning_error(runs[floor._label(SPEEDS, "I", floor.ROLLING)]) is None


@pytest.mark.nightly
@pytest.mark.parametrize("name", NAMES)
def test_every_claim_of_a_floor_is_as_expected_and_can_fail(name):
    made = figure_of(name)
    assert [claim.text for claim in made.claims if not claim.as_expected] == []
    on_floor = {label: run for label, run in made.runs.items() if run.floor}
    worst, best = (
        f(on_floor.values(), key=lambda run: (run.stopped is not None, run.slipping)) for f in (max, min)
    )
    otherwise = np.zeros(len(made.figure.claims(made.runs)), int)
    for same in (worst, best):
        runs = {label: same if run.floor else run for label, run in made.runs.items()}
        otherwise += [a.holds != b.holds for a, b in zip(made.claims, made.figure.claims(runs), strict=False)]
    assert otherwise.all()


@pytest.mark.nightly
def test_pictures_of_a_floor_are_drawn():
    for name in NAMES:
        made = figure_of(name)
        assert pictures(lambda made=made: made.figure.draw(made.runs), made.figure.title, "")["svg"]
