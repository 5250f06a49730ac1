"""The batch simulator's vectors: every sample has the bits of a run of its own, with vectors of any size."""

from dataclasses import replace

import numpy as np
import pytest
from noslip.codegen.dynamics import compile_dynamics
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.specification.spec import DriveSection, LimitsSection, read_spec
from noslip.simulation.sweeping import program
from noslip.simulation.sweeping.batch import Batch
from noslip.tests.simulation.test_batch import KINDS, SPECS, gripping, sensed, spec

SCALAR, SIZES = 0, (1, 2, 3)  # those that the processor does not have are the next smaller ones
COUNT = 21  # no multiple of the lanes


def driven(kind):
    """The line with drives that follow commands of velocity."""
    made = spec("line")
    return replace(
        made,
        drive=DriveSection(
            kind=kind, bandwidth=30.0, delay=0.015, most_speed=(30.0,), most_acceleration=(20.0,)
        ),
    )


def damped():
    """The line with the law that is damped near the normal; some headings begin within its band."""
    made = spec("line")
    return replace(made, output=replace(made.output, near_singular="damped", band=0.4))


def trailer():
    """A robot with a joint behind it, whose plant has sines of sums of angles."""
    made = read_spec(SPECS / "robots" / "tractor_trailer.toml")
    return replace(made, simulation=replace(made.simulation, duration=1.0, period=0.02))


MORE = {
    "plain": spec,
    "limited": lambda: replace(spec("line"), limits=LimitsSection(torque=(4.0,))),
    "slowed": lambda: replace(spec("line", delay=0.003), limits=LimitsSection(torque=(4.0,), mode="slow")),
    "grip": lambda: gripping(torque=(4.0,), friction="given"),
    "earned": lambda: gripping(torque=(4.0,)),
    "damped": damped,
    "few steps": lambda: spec("circle", period=0.1, output_step=0.03),
    "sensed": sensed,
    "velocity": lambda: driven("velocity"),
    "velocity and torque": lambda: driven("velocity+torque"),
    "trailer": trailer,
}
ALL = MORE | {kind: each for kind, (each, _) in KINDS.items() if kind not in MORE}
CHOSEN = ("plain", "few steps", "sensed")


def varied(batch: Batch) -> np.ndarray:
    """Samples with other masses, starts and gains, some of them wild: singular at once or soon, refused,
    or not finite."""
    random = np.random.default_rng(3)
    names = [name for name in batch.nominal if name.startswith(("plant.m", "plant.I", "gains.k", "initial."))]
    table = batch.table(
        {name: batch.nominal[name] * random.uniform(0.8, 1.2, COUNT) for name in names}, COUNT
    )
    heading = [k for k, name in enumerate(batch.inputs) if name in ("initial.heading", "initial.phi")]
    table[::4, heading] += random.uniform(-3, 3, (len(table[::4]), 1))
    table[5, batch.inputs.index("plant.m_c" if "plant.m_c" in batch.inputs else names[0])] = -1.0
    table[7, heading] = 1e7  # beyond the range of sine and cosine
    if "seed" in batch.inputs:
        table[:, batch.inputs.index("seed")] = np.arange(COUNT)
    return table


@pytest.mark.parametrize(
    "kind", [*CHOSEN, *(pytest.param(kind, marks=pytest.mark.nightly) for kind in ALL if kind not in CHOSEN)]
)
def test_bits_are_those_of_single_runs(kind):
    """All outcomes, for samples of all sorts, whatever their order and the vectors."""
    made = ALL[kind]()
    alone = Batch(made, vectors=SCALAR, instants=(0.5,), accuracy=1e-10)
    table = varied(alone)
    expected = alone.run(table)
    assert alone.vectors == "scalar"
    for size in SIZES:
        batch = Batch(made, vectors=size, instants=(0.5,), accuracy=1e-10)
        assert batch.vectors != "scalar"
        assert batch.run(table).tobytes() == expected.tobytes(), (kind, size)
        assert batch.run(table[::-1])[::-1].tobytes() == expected.tobytes(), (kind, size)
    if kind == "few steps":
        assert len(set(expected[:, alone.outcomes.index("steps")])) > 2, (
            "some runs are repeated with shorter steps"
        )
    if kind == "damped":
        assert "singular" not in {alone.status(number) for number in expected[:, 0]}
    if kind == "plain":
        assert {"ok", "singular", "range", "bad_parameter"} <= {
            alone.status(number) for number in expected[:, 0]
        }


@pytest.mark.parametrize(
    ("name", "drives", "expected"),
    [
        *[
            (law, ("torque",), "robot and law")
            for law in ("type_i", "type_iv_line", "type_iv_circle", "type_iv_line_damped")
        ],
        ("type_iv_line", ("velocity", "velocity+torque"), "robot"),
        ("type_iv_line_kinematic", ("kinematic",), "robot"),
        *[
            (f"{law}_extended", ("torque", "velocity"), None)
            for law in ("type_i", "type_iv_line", "type_iv_circle")
        ],
    ],
)
def test_what_vectors_have(name, drives, expected):
    """As the table of docs/sweep.md says: the robot with all drives, the law with torques;
    nothing with a dynamic extension."""
    law = law_of(find_robot("labmate"), name)
    for drive in drives:
        found = program.vectors_of(
            law, compile_dynamics(law.system), "double", program.LoopParts(drive=drive)
        )
        assert (found and ("robot and law" if found.steps else "robot")) == expected


def test_samples_with_other_times_wait_for_each_other():
    """Three delays and two periods, in turn: the samples of each go together."""
    made = spec("line", delay=0.001)
    delay, period = np.array([0.0, 0.002, 0.004] * 40), np.array([0.01, 0.02] * 60)
    batches = [Batch(made, vectors=size) for size in (SCALAR, max(SIZES))]
    tables = [batch.table({"simulation.delay": delay, "simulation.period": period}, 120) for batch in batches]
    alone, together = (batch.run(table) for batch, table in zip(batches, tables, strict=True))
    assert alone.tobytes() == together.tobytes()


@pytest.mark.parametrize(
    "kind, right, wrong",
    [
        ("limited", "force_2;", "(-force_2);"),
        ("limited", "fine &= noslip_within_lanes", "(void)noslip_within_lanes"),
        ("limited", "h[1] = ", "h[1] = -"),
        ("grip", "ground[3] = ", "ground[3] = LANES(2.0) * "),
    ],
    ids=["dynamics", "limit", "output", "load"],
)
def test_another_operation_is_found(kind, right, wrong, monkeypatch):
    """A sign in the dynamics, a limit that is not tested, a sign in the outputs,
    twice the load of a wheel."""
    files = program.Vectors.files
    monkeypatch.setattr(
        program.Vectors,
        "files",
        lambda self: {name: text.replace(right, wrong) for name, text in files(self).items()},
    )
    program.program.cache_clear()
    try:
        with pytest.raises(AssertionError, match=f"'{kind}'"):
            test_bits_are_those_of_single_runs(kind)
    finally:
        program.program.cache_clear()
