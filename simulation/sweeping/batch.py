"""Many closed loops of one SPEC, each with its own numbers, simulated by the C of batch.c."""

from threading import Lock
from typing import Any

import casadi as ca
import numpy as np

from ...codegen.derivation.grip import is_wide
from ...codegen.loop.stages import check
from ...model.contacts import GRAVITY
from ...readers.errors import BadInput
from ..controllers import SCALAR
from ..controllers.approach import PERIODS, SETTLING
from ..controllers.controller import ON_LIMIT
from ..controllers.integral import hurwitz
from ..controllers.odometry import MODES, arm_function, has_arm, wheels_function
from ..controllers.tracking import REVERSING, STOP
from ..guidance import accelerations
from ..loop import ALONG, LATERAL, earning, make_loop, roughness
from ..planning.profile import top_speed
from ..plant import standing
from ..sensing import gyro_bias, wheel_noise
from ..specification.spec import MOST_ROWS, Spec
from ..starts import extension_starts, starts
from .inputs import SEED, SEEDS, inputs_of
from .program import LoopParts, knows_ground, program

LONGEST = 0.01  # s
ACCURACY = 1e-9
BAND = 0.01
VECTORS = 3  # those of the processor
CHUNK = 4096  # samples prepared at a time, so that memory stays constant
Structs = Any  # an array of structs, whose members have no types in NumPy's stubs, which take mypy long
_one = Lock()  # CasADi's functions are evaluated by one thread at a time


class Batch:
    """Closed loops of a SPEC with a sampled controller, run in C with the same meaning as in
    `noslip simulate`.

    `inputs`: names of the numbers that a sample has, dotted as in the SPEC ("plant.m_c", "initial.x_c",
    "limits.torque[0]"), and "seed"; `nominal`: what they are in the SPEC. `outcomes`: names of what comes of
    it, SI:

    status      a number, see `status`: ok, saturated, arrived, or the reason for which the run stopped early
                (t_end, s)
    final.ROW, peak.ROW, settling.ROW  of each output: y - y_d at the last output time, its largest absolute
                                       value, and the last
                output time (s) at which it was beyond the band
    saturated   time (s) with an input at its limit; effort.INPUT: the largest absolute value of each input
    grip, will_slip  time (s) with these statuses, where inputs are limited by friction
    slipping    time (s) with this status, where slip is noticed: false alarms, since the wheels of a sweep
                roll
    use         largest friction use of any contact at an output time, with [contact], of a robot whose laws
                can limit it
    end.STATE   true state at the end
    integration_error  estimated error of the integrator, the largest component of the state
    steps       steps of the integrator between two calls; order: of its method
    error.ROW[K]  y - y_d at the first output time not before the instant K, NaN if the run stopped before

    A sample that is not run because a number is rejected has NaN in all outcomes except status and t_end.
    """

    def __init__(
        self,
        spec: Spec,
        accuracy: float = ACCURACY,
        band: float | tuple[float, ...] = BAND,
        instants: tuple[float, ...] = (),
        longest: float = LONGEST,
        vectors: int = VECTORS,
    ):
        """`accuracy`: a run whose integration error is larger is repeated with the method of order 6 instead
        of 4, then with half the step, five times at most; `longest`: the longest step, s. `band`: one for all
        outputs or one for each, in their units. `instants`: s, ascending. `vectors`: the longest, as in
        batch.h; the outcomes are the same with all.

        Raises BadInput and ModelError as `simulate` does, for a SPEC that is not sampled and for a backend
        other than c and cf.
        """
        check(spec, "noslip sweep")
        check(spec, "the C of a sweep")
        self.loop = make_loop(spec)
        self._earns = spec.limits is not None and spec.limits.mode == "grip" and earning(spec).period > 0
        self._notices = spec.limits is not None and spec.limits.notice_slip is not None
        self.law = law = self.loop.law
        drive = spec.drive.kind if spec.drive else "torque"
        if drive != "torque" and law.system.redundant:
            raise BadInput(
                f'[drive] kind = "{drive}": a sweep has it for as many inputs as quasi-velocities; use '
                "noslip simulate"
            )
        self._route = self.loop.route
        self._wheels: ca.Function | None
        try:
            self._wheels = wheels_function(law.system)
        except BadInput:  # a robot without a pose: make_loop has checked that none is needed
            self._wheels = None
        self._inputs = inputs_of(spec, self.loop)
        self.spec = self._inputs.spec
        self.inputs, self.nominal = self._inputs.names, self._inputs.nominal
        self.table, self.spec_of = self._inputs.table, self._inputs.spec_of
        scalar = SCALAR[spec.simulation.backend]
        parts = LoopParts(
            sensed=spec.sensors is not None,
            reckoned=spec.sensors is not None and spec.sensors.pose == "reckoned",
            route=self._route is not None,
            profile=len(spec.output.segments) if spec.reference.profiled else 0,
            approach=spec.reference.approach is not None,
            integrals=self.loop.integral.rows,
            observers=self.loop.observers.rows,
            notices=self._notices,
            accelerates=spec.sensors is not None and spec.sensors.accelerometer is not None,
            drive=drive,
            earns=self._earns,
        )
        self._program = program(law, scalar, parts)
        self._sample, self._row = (self._program.type(name) for name in ("batch_sample", "batch_row"))
        self._outcome = self._program.type("batch_outcome")
        self._settings = self._make_settings(accuracy, band, instants, longest, vectors)
        names = self._outcome_names(len(instants))
        self._kept = np.array([self._applies(name) for name in names])
        self.outcomes = [name for name, kept in zip(names, self._kept, strict=True) if kept]

    def run(self, table: np.ndarray) -> np.ndarray:
        """Outcomes (N, outcomes) of samples (N, inputs). A row depends on its sample only. The GIL is
        released."""
        made = np.empty((len(table), len(self._kept)))
        cast, lib = self._program.ffi.cast, self._program.lib
        for start in range(0, len(table), CHUNK):
            samples = self._samples(np.asarray(table[start : start + CHUNK], float))
            part = made[start : start + CHUNK]
            given = (
                cast("batch_sample *", samples.ctypes.data),
                len(samples),
                cast("double *", part.ctypes.data),
            )
            lib.batch_run(self._settings, *given, made.shape[1])
        return made[:, self._kept]

    @property
    def vectors(self) -> str:
        """The vectors in which this processor runs samples: avx512, avx2 or plain;
        scalar for one after the other."""
        return self._program.ffi.string(self._program.lib.batch_vectors(self._settings)).decode()

    @property
    def computed(self) -> str:
        """What vectors compute here, as text: the law is among it where nothing else belongs to the loop."""
        parts = ", robot and law" if self._program.steps else ", robot"
        return self.vectors + (parts if self.vectors != "scalar" else "")

    def status(self, number: float) -> str:
        """Return the name of a status."""
        return self._program.ffi.string(self._program.lib.noslip_status_name(int(number))).decode()

    def trace(self, row: np.ndarray) -> np.ndarray:
        """Return records (t, x, tau, error, status, piece) of one sample, a row of a table,
        at all output times."""
        simulation, cast = self.spec.simulation, self._program.ffi.cast
        duration = row[self.inputs.index("simulation.duration")]
        rows = np.zeros(int(duration / simulation.output_step) + 3, self._row)
        samples = self._samples(np.atleast_2d(np.asarray(row, float)))
        sample, place = cast("batch_sample *", samples.ctypes.data), cast("batch_row *", rows.ctypes.data)
        return rows[: self._program.lib.batch_trace(self._settings, sample, place, len(rows))]

    # -- settings shared by all samples ----------------------------------------------------------------------

    def _make_settings(
        self,
        accuracy: float,
        band: float | tuple[float, ...],
        instants: tuple[float, ...],
        longest: float,
        vectors: int,
    ):
        spec, ffi = self.spec, self._program.ffi
        self._instants = ffi.new("double[]", [*instants, 0.0])  # referenced by pointers in the settings
        self._path = ffi.NULL
        settings = ffi.new("batch_settings *")
        settings.longest, settings.accuracy, settings.vectors = longest, accuracy, vectors
        settings.output_step = spec.simulation.output_step
        settings.band = list(band) if isinstance(band, tuple) else [band] * len(settings.band)
        settings.instants, settings.instant = len(instants), self._instants
        if spec.correction:
            settings.corrected, settings.correction_mode = 1, MODES[spec.correction.mode]
        if spec.limits and not spec.kinematic:
            settings.on_limit = ON_LIMIT.index(spec.limits.mode)
        if self._route:
            segments, options = spec.output.segments, self._route.options
            kind = ffi.typeof(settings.path).item.cname
            self._path = ffi.new(f"{kind}[]", [vars(segment) for segment in segments])
            settings.path, settings.segments, settings.closed = self._path, len(segments), options.closed
            settings.reversing, settings.stop = REVERSING.index(options.reversing), STOP.index(options.stop)
        return settings

    def _outcome_names(self, instants: int) -> list[str]:
        rows = [row.name for row in self.law.output.rows]
        members = {"final": rows, "peak": rows, "settling": rows, "end": self._inputs.state}
        members["effort"] = [q.name for q in self.law.system.mechanism.inputs]
        fields = self._outcome.names or ()
        names = [
            f"{field}.{member}" if member else field
            for field in fields
            for member in members.get(field, [""])
        ]
        return [*names, *[f"error.{row}[{k}]" for row in rows for k in range(instants)]]

    def _applies(self, outcome: str) -> bool:
        """Return whether the SPEC asks for what an outcome says."""
        if outcome == "slipping":
            return self._notices
        if outcome in ("grip", "will_slip"):
            return self.spec.limits is not None and self.spec.limits.mode == "grip"
        return outcome != "use" or (self.spec.contact is not None and knows_ground(self.law))

    # -- samples ---------------------------------------------------------------------------------------------

    def _samples(self, table: np.ndarray) -> np.ndarray:
        """Return rows of a table as structs of the C."""
        with _one:
            return self._filled(table)

    def _filled(self, table: np.ndarray) -> np.ndarray:
        law, mechanism = self.law, self.law.system.mechanism
        given = dict(zip(self.inputs, table.T, strict=True))
        made: Structs = np.zeros(len(table), self._sample)
        for group in ("plant", "believed"):
            where = "parameters" if group == "believed" else group
            made[group] = np.column_stack([given[f"{where}.{p.name}"] for p in mechanism.parameters])
        for k, gain in enumerate(law.gains):
            made["gains"][:, k] = given[f"gains.{gain.name}"]
        for name, rows in (("ki", self.loop.integral.rows), ("ko", self.loop.observers.rows)):
            for k, row in enumerate(rows):
                made[name][:, k] = given[f"gains.{name}_{row}"]
        for name, where in (("limit", "limits.torque"), ("integral_limit", "limits.integral"),
                            ("disturbance_limit", "limits.disturbance"), ("mean", "sensors.noise.mean"),
                            ("sd", "sensors.noise.sd")):  # fmt: skip
            for k in range(made[name].shape[1]):
                made[name][:, k] = given.get(f"{where}[{k}]", 0.0)
        made["seed"] = given.get(SEED, 0.0)
        for name in ("period", "delay", "duration"):
            made[name] = given[f"simulation.{name}"]
        if self.spec.sensors:
            made["sensor_period"], made["counts"] = given["sensors.period"], given["sensors.counts"]
        for name in ("mu", "share", "height"):
            made[name] = given.get(f"contact.{name}", 0.0)
        height, part = standing(mechanism)(made["believed"].T).full()
        made["height"] = np.where(made["height"] == 0, height, made["height"])
        made["margin"] = given.get("limits.margin", 0.0)
        if self._earns:
            made["earned"], made["error"] = made["period"], given["limits.error"]
            made["known"] = given.get("limits.known", 0.0)
            made["coarse"], made["lag"] = roughness(
                made["period"], made["delay"], made["counts"], made["sd"].max(axis=1)
            )
        if self.spec.correction:
            made["correction_rate"] = given["correction.rate"]
            with np.errstate(divide="ignore", invalid="ignore"):
                made["release"] = given.get("correction.release", 1 / given["correction.rate"])
        if self.spec.drive and self.spec.drive.takes_velocity:
            self._set_drives(made, given, part)
        if self._wheels:
            W, ahead = (value.full() for value in self._wheels(made["believed"].T))
            made["forward"], made["turn"], made["ahead"] = W[0].reshape(-1, 2), W[1].reshape(-1, 2), ahead[0]
        if has_arm(law.system):
            for name, whose in (("arm", "believed"), ("true_arm", "plant")):
                made[name] = arm_function(law.system)(made[whose].T).full().T
        if self.spec.reference.approach:
            linear, angular = (
                given.get(f"reference.approach.{name}", np.zeros(len(made)))
                for name in ("acceleration", "angular")
            )
            made["acceleration"][:, :-1] = np.transpose(accelerations(law, linear, angular))
            with np.errstate(divide="ignore", invalid="ignore"):
                made["jerk"] = made["acceleration"] * (given["reference.approach.jerk"] / linear)[:, None]
            made["settling"] = np.maximum(SETTLING, PERIODS * made["period"])
        if self._notices and self._wheels:
            self._notice(self._wheels, made, given)
        L = self._point(made, given)
        made["start"] = self._starts(made, given, L)
        made["extension"][:, : len(law.extension)] = self._extensions(made, given)
        made["refused"] = np.where(made["refused"] == 0, self._refused(made, table), made["refused"])
        return made

    def _set_drives(self, made: Structs, given: dict[str, np.ndarray], part: np.ndarray) -> None:
        """Set the drives, and for a kinematic law the limits of the vehicle's motion,
        with a `part` of the weight on contacts."""
        with np.errstate(divide="ignore", invalid="ignore"):
            made["omega"], made["drive_delay"] = 2 * np.pi * given["drive.bandwidth"], given["drive.delay"]
            for k in range(self.law.system.dof):
                for name in ("most_speed", "most_acceleration"):
                    made[name][:, k] = given.get(f"drive.{name}[{k}]", given[f"drive.{name}[0]"])
            lag = made["drive_delay"] + 1 / made["omega"] + made["period"]
            made["drive_band"] = 2 * made["most_acceleration"] * lag[:, None]
        if self.spec.kinematic and self.spec.limits:
            most = made["mu"] * (1 - made["margin"]) * made["share"] * part * GRAVITY
            made["vehicle_along"], made["vehicle_lateral"] = ALONG * most, LATERAL * most

    @staticmethod
    def _notice(wheels: ca.Function, made: Structs, given: dict[str, np.ndarray]) -> None:
        """Set the sensors that notice slip, and what is known of them, as `slip_options`."""
        made["true_ahead"] = wheels(made["plant"].T)[1].full()[0]
        for name in ("window", "geometry", "deviations", "least", "lower", "pause", "rise", "hold"):
            made[name] = given[f"limits.notice_slip.{name}"]
        for sensor, name in (("gyro", "gyro"), ("accelerometer", "acceleration")):
            for part in ("noise", "bias"):
                made[f"{name}_{part}"] = given.get(f"sensors.{sensor}.{part}", 0.0)
        made["wheel_noise"] = wheel_noise(made["sd"], made["sensor_period"], made["period"])
        made["bias"] = gyro_bias(made["gyro_bias"], made["turn"], made["mean"])

    def _point(self, made: Structs, given: dict[str, np.ndarray]) -> np.ndarray:
        """Set the path and the position of P_l. Return its L, m."""
        output, law = self.spec.output, self.law
        zeros = np.zeros(len(made))
        on_axle = output.extension and not output.own
        L, made["W"] = (
            -made["ahead"] if on_axle else given.get("output.L", zeros),
            given.get("output.W", zeros),
        )
        mirrored = given.get("output.L_backward", -L - 2 * made["ahead"])
        if self._route:
            made["L"] = np.column_stack([L, mirrored])
            for name in ("speed", "deceleration", "creep", "lateral", "angular"):
                made[name] = given.get(f"reference.{name}", 0.0)
            if self.spec.reference.profiled:
                made["along"] = given["reference.acceleration"]
                most = np.maximum(made["along"], made["deceleration"])
                made["speed"] = np.minimum(made["speed"], top_speed(output.segments, made["lateral"], most))
            for k, c in enumerate(law.config):  # the others are the segment's
                made["config"][:, k] = given.get(f"output.{c.name}", zeros)
            return made["L"][:, int(output.segments[0].backward)]
        if output.type == "IV" and self._wheels:
            speed = given["reference.speed"]
            backwards = speed * (L + made["ahead"]) < 0
            if output.reversing == "switch":
                L = np.where(backwards, mirrored, L)
            if output.reversing != "allow":
                made["refused"][(speed * (L + made["ahead"]) < 0)] = self._program.lib.NOSLIP_UNSTABLE
        for k, c in enumerate(law.config):
            if output.own:
                made["config"][:, k] = given[f"output.parameters.{c.name}"]
            else:
                made["config"][:, k] = (
                    L if c.name == "L" else given.get(f"output.{c.name}", given.get(f"output.path.{c.name}"))
                )
        entry = 0
        for k, degree in enumerate(law.linearization.relative_degree):
            if output.type == "IV":
                position, velocity = (given["reference.speed"] if k else zeros), zeros
            else:
                position, velocity = given[f"reference.position[{k}]"], given[f"reference.velocity[{k}]"]
            for name, values in (("offset", (position, velocity)), ("slope", (velocity, zeros))):
                for order in range(min(degree, 1) + 1):
                    made[name][:, entry + order] = values[order]
            entry += degree + 1
        return L

    def _starts(self, made: Structs, given: dict[str, np.ndarray], L: np.ndarray) -> np.ndarray:
        if self.spec.initial and self.spec.initial.q is not None:
            return np.column_stack([given[f"initial.{name}"] for name in self._inputs.state])
        pose = np.column_stack([given[f"initial.{name}"] for name in ("point[0]", "point[1]", "heading")])
        return starts(self.law.system, made["plant"], (L, made["W"]), pose, given["initial.speed"])

    def _extensions(self, made: Structs, given: dict[str, np.ndarray]) -> np.ndarray:
        """Return the states of the dynamic extension at the start; NaN where the start is."""
        names = [name for name in self.inputs if name.startswith("initial.extension[")]
        if names or not self.law.extension:
            return np.column_stack([np.zeros((len(made), 0)), *[given[name] for name in names]])
        config = made["config"][:, : len(self.law.config)]
        config = np.broadcast_to(self.loop.guidance.leg.config, config.shape) if self._route else config
        return extension_starts(self.law, made["believed"], config, made["start"], made["offset"])

    def _refused(self, made: Structs, table: np.ndarray) -> np.ndarray:
        """Return 0, or the status with which a SPEC with these numbers is rejected,
        apart from the checks made by the C."""
        period, delay, duration = (made[name] for name in ("period", "delay", "duration"))
        with np.errstate(divide="ignore", invalid="ignore"):
            good = np.isfinite(table).all(axis=1) & np.isfinite(made["start"]).all(axis=1)
            good &= np.isfinite(made["extension"]).all(axis=1)
            good &= (period > 0) & (delay >= 0) & (delay <= period) & (duration > 0)
            good &= (duration / period <= MOST_ROWS) & (
                duration / self.spec.simulation.output_step <= MOST_ROWS
            )
            if self.spec.drive and self.spec.drive.takes_velocity:
                good &= (made["omega"] > 0) & (made["drive_delay"] >= 0)
            good &= (made["sd"] >= 0).all(axis=1) & (made["sensor_period"] >= 0) & (made["counts"] >= 0)
            good &= (made["seed"] >= 0) & (made["seed"] < SEEDS) & (made["limit"] >= 0).all(axis=1)
            good &= (
                (made["share"] <= 1) & (made["height"] >= 0) & (made["margin"] >= 0) & (made["margin"] < 1)
            )
            if self.spec.contact:
                good &= (made["mu"] > 0) & (made["share"] > 0)
                good &= (made["height"] == 0) | is_wide(self.law.system)
            if self._route and self.spec.reference.profiled:
                good &= (
                    (made["angular"] >= 0)
                    & (made["lateral"] > 0)
                    & (made["along"] > 0)
                    & (made["deceleration"] > 0)
                )
            if self.spec.correction:
                good &= (made["correction_rate"] > 0) & (made["release"] > 0)
            for k, row in enumerate(self.loop.integral.rows):
                good &= self._stable(row, made["ki"][:, k], made)
            good &= (made["ko"] >= 0).all(axis=1)
        return np.where(good, 0, self._program.lib.NOSLIP_BAD_PARAMETER)

    def _stable(self, row: str, ki: np.ndarray, made: Structs) -> np.ndarray:
        """Whether an output with integral action is stable."""
        own = [
            made["gains"][:, k] for k, gain in enumerate(self.law.gains) if gain.name.partition("_")[2] == row
        ]
        return (ki == 0) | hurwitz([np.ones_like(ki), *own[::-1], ki])
