"""The stages of a closed loop in their order, each with its place in a SPEC, its signals and columns, and
what goes with it.

A SPEC is checked against the rows of all stages (`check`); docs and `noslip stages` print them.
"""

from dataclasses import dataclass

from ...model.law import ControlLaw
from ...readers.errors import BadInput
from .rules import USERS, Bound, Excludes, Needs, Option, Rule

SIGNALS = {  # name -> unit and meaning; a unit per output or input is that of the robot's
    "state": ("SI", "true coordinates q and quasi-velocities nu"),
    "sensed rates": ("rad/s", "quasi-velocities that the controller sees, with noise"),
    "wheel angles": ("rad", "angles of the wheels, rounded to counts"),
    "yaw rate": ("rad/s", "mean between two calls, of a gyro"),
    "acceleration": ("m/s^2", "mean forward acceleration between two calls"),
    "measured pose": ("m, m, rad", "x, y and heading, measured now and then"),
    "seen": ("SI", "the state that the controller sees"),
    "friction": ("1", "the mu that the controller believes, and how far the pose may be off"),
    "parameters": ("SI", "parameters that the controller believes"),
    "config": ("SI", "parameters of the output map: the point P_l, and the curve that it follows"),
    "reference": ("SI", "desired outputs and their derivatives"),
    "addition": ("SI", "what is added to the virtual input v"),
    "inputs": ("N or N m", "the law's inputs tau; of a kinematic law its commands, in the unit of nu"),
    "given": ("N or N m, or of nu", "what the drives are given, after the delay"),
    "force": ("N or N m", "what the drives give to the robot"),
    "status": ("1", "ok, saturated, singular, ..."),
    "outputs": ("SI", "the true outputs y"),
}


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A stage: it is in the loop of a SPEC that has one of the options `where`. `module` is its C in
    runtime_c/; `columns` are those that it adds to a run, with <NAME> for what is a column each.
    """

    name: str
    about: str
    where: tuple[str, ...]
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    module: str = ""
    columns: tuple[str, ...] = ()
    rules: tuple[Rule, ...] = ()

    def as_json(self) -> dict[str, object]:
        """Return the stage as `noslip stages --json` prints it:
        `users` are those that need or exclude something, with how."""
        return {
            "name": self.name,
            "about": self.about,
            "section": list(self.where),
            "module": self.module,
            "reads": [{"signal": name, "unit": SIGNALS[name][0]} for name in self.reads],
            "writes": [{"signal": name, "unit": SIGNALS[name][0]} for name in self.writes],
            "columns": list(self.columns),
            **{
                of.kind: [rule.as_json() for rule in self.rules if isinstance(rule, of)]
                for of in (Needs, Excludes, Bound)
            },
            "users": {user: [str(rule) for rule in self.rules if rule.concerns(user)] for user in USERS},
        }

    def __str__(self) -> str:
        signals = {
            verb: ", ".join(names)
            for verb, names in (("reads", self.reads), ("writes", self.writes))
            if names
        }
        parts = [f"{verb} {names}" for verb, names in signals.items()]
        parts += [f"columns {', '.join(self.columns)}"] if self.columns else []
        head = f"{self.name}: {', '.join(self.where)}"
        return "\n".join(
            [head, *(f"  {line}" for line in (self.about, "; ".join(parts), *map(str, self.rules)))]
        )


COURSE = '[output] path = { kind = "course" }'
SAMPLED, SCALAR = "[simulation] period > 0", '[simulation] backend = "casadi" | "c" | "cf"'
TIMED, IN_TIME = '[output] type != "IV"', ("[reference] circle", "[reference] oscillation")
# In all its variants
LAW_READS, LAW_WRITES = ("seen", "config", "reference", "addition", "parameters"), ("inputs", "status")
NOT_IN_C = "the C of a sweep", "each sample is run by noslip simulate"
NOT_IN_FIRMWARE = "export --firmware", "a follower does not have it"
NO_REVERSING = (
    '[output] reversing = "refuse" | "switch"',
    "it needs no reversing: P_l on the axle is followed forward and in reverse",
)
VELOCITY = '[drive] kind = "velocity" | "velocity+torque" | "kinematic"'


def only_simulated(way: str) -> tuple[Rule, ...]:
    """Return the rows of a way in which desired outputs move that `noslip simulate` has,
    and other users have not."""
    return (
        Excludes(way, "noslip sweep", "a sweep does not have it yet; use noslip simulate"),
        Excludes(way, "noslip outer-loop", "the steady motion is along a line, or on a path of type IV"),
        Needs(
            f"analyse --start with {way}", "[output] extension", "starts are certified along lines and paths"
        ),
    )


STAGES = (
    Stage(
        name="sensors",
        about="wheel rates with noise, angles in counts, gyro and accelerometer, read at the calls of the "
        "controller",
        where=("[sensors]",),
        reads=("state",),
        writes=("sensed rates", "wheel angles", "yaw rate", "acceleration"),
        rules=(
            Needs("[sensors]", SAMPLED, "sensors are read at the calls of the controller"),
            Needs(
                "export --firmware",
                "[sensors] counts",
                "a vehicle has encoders: their counts of a turn of a wheel",
            ),
        ),
    ),
    Stage(
        name="dead reckoning",
        about="the pose from the angles of the wheels, corrected now and then",
        where=("[sensors]", "[correction]"),
        reads=("wheel angles", "sensed rates", "state"),
        writes=("seen",),
        module="noslip_odometry.h",
        columns=("seen_<STATE>",),
        rules=(
            Needs("[correction]", "[sensors]", "without them the pose is the true one"),
            Excludes("[correction]", '[sensors] pose = "true"', "the true pose needs no correction"),
            Excludes(
                "export --firmware",
                '[sensors] pose = "true"',
                'a vehicle reckons its pose: set pose = "reckoned"',
            ),
            Excludes(
                "[correction]",
                "export --firmware",
                "call the follower's correct where the pose is measured; leave it out",
            ),
            Excludes("[sensors] with a steered wheel", *NOT_IN_C),
        ),
    ),
    Stage(
        name="filter",
        about="the pose by an extended Kalman filter, from wheels, gyro and poses that are measured now and "
        "then",
        where=("[estimator]",),
        reads=("wheel angles", "yaw rate", "measured pose"),
        writes=("seen",),
        module="noslip_ekf.h",
        columns=("seen_<STATE>",),
        rules=(
            Needs("[estimator]", "[sensors]", "without them the pose is the true one"),
            Excludes("[estimator]", "[correction]", "give it poses by [estimator] pose"),
            Excludes(
                "[estimator]",
                "a steered wheel",
                "its filter is given the steering angle, which a run does not do yet",
            ),
            Needs("[estimator]", SCALAR, "emulated processors have no filter"),
            Excludes("[estimator]", *NOT_IN_C),
            Excludes("[estimator]", *NOT_IN_FIRMWARE),
        ),
    ),
    Stage(
        name="slip",
        about="slip is noticed where the gyro differs from the wheels; the believed friction is then lower",
        where=("[limits] notice_slip",),
        reads=("wheel angles", "yaw rate", "acceleration"),
        writes=("friction", "status"),
        module="noslip_slip.h",
        columns=("uncertain_heading", "uncertain_way"),
        rules=(
            Excludes(
                "[limits] notice_slip",
                '[drive] kind = "kinematic"',
                "it lowers the friction of a law that gives torques",
            ),
            Needs("[limits] notice_slip", '[limits] mode = "grip"', "other modes do not use friction"),
            Needs("[limits] notice_slip", "[sensors] gyro", "slip is where it differs from the wheels"),
            Excludes("[limits] notice_slip", *NOT_IN_FIRMWARE),
            Bound("[limits.notice_slip] least", "[contact] mu", "friction is lowered from there"),
            Bound(
                "[limits.notice_slip] pause",
                "[limits.notice_slip] hold",
                "a pause ends before friction rises again",
            ),
        ),
    ),
    Stage(
        name="adaptation",
        about="parameters of the controller, learned by recursive least squares",
        where=("[adaptation]",),
        reads=("seen", "inputs"),
        writes=("parameters",),
        module="noslip_adaptation.h",
        columns=("learned_<PARAMETER>",),
        rules=(
            Needs("[adaptation]", SAMPLED, "it learns from the motion between two calls"),
            Excludes(
                "[adaptation]", ("[simulation] delay", "[drive]"), "the inputs must act as they are given"
            ),
            Bound(
                "[adaptation] window",
                "[simulation] period",
                "noise of the rates pulls masses down unless it is smoothed",
                sign=">=",
                factor=5.0,
            ),
            Needs("[adaptation]", SCALAR, "emulated processors do not learn"),
            Excludes("[adaptation]", *NOT_IN_C),
            Excludes("[adaptation]", *NOT_IN_FIRMWARE),
        ),
    ),
    Stage(
        name="composite path",
        about="lines and arcs that P_l follows one after the other, with stops at the end and at cusps",
        where=("a composite path",),
        reads=("seen",),
        writes=("config", "reference", "status"),
        module="noslip_path.h",
        columns=("piece",),
        rules=(
            Needs(
                "export --firmware",
                "a composite path",
                'a follower drives lines and arcs: path = { kind = "composite" }',
            ),
            *(
                Needs(
                    f"[reference] {key}",
                    ("a composite path", COURSE),
                    "elsewhere there is no end of the path",
                )
                for key in ("deceleration", "creep")
            ),
            Excludes(
                "segments in reverse", "a steered wheel", "it folds in reverse; give them without backward"
            ),
        ),
    ),
    Stage(
        name="profile",
        about="the speed along a composite path: the fastest within accelerations",
        where=("a profile of the speed",),
        reads=("seen", "reference"),
        writes=("reference",),
        module="noslip_profile.h",
        rules=(
            *(
                Needs(f"[reference] {key}", "a composite path", "the speed on other paths has no profile")
                for key in ("lateral", "acceleration", "angular")
            ),
            Needs('[reference] speed = "fastest"', "a composite path", "give a speed in m/s"),
            Excludes("a profile of the speed", *NOT_IN_FIRMWARE),
            Needs(
                "a profile that leaves accelerations out",
                "[contact]",
                "these are of friction: give its mu, or lateral, acceleration, deceleration and angular",
            ),
            *(
                Needs(f"[reference] {key}", "a profile of the speed", 'give lateral, or speed = "fastest"')
                for key in ("acceleration", "angular")
            ),
        ),
    ),
    Stage(
        name="course",
        about="a smooth curve, followed in time or from wherever the robot is beside it",
        where=("[reference] course",),
        reads=("seen",),
        writes=("config", "reference", "status"),
        module="noslip_course.h",
        columns=("distance", "piece"),
        rules=(
            Needs(COURSE, "[reference] course", "it is the path that is followed"),
            Needs(
                "[reference] course",
                (TIMED, COURSE, "[feedback]"),
                'course does not apply to type IV otherwise: set path = { kind = "course" }',
            ),
            Excludes(
                "[reference] velocity",
                '[reference.course] follow = "path"',
                "such a course does not depend on time",
            ),
            Needs(
                "parts of the course in reverse",
                (COURSE, "[feedback]"),
                'parts of negative length are for type IV with path = { kind = "course" }, and arclength = '
                "true or a P_l off the "
                "axle",
            ),
            Needs(
                COURSE + " with cusps of the course",
                ("[output] extension", "[output] arclength", '[output] reversing = "switch"'),
                "at a cusp P_l off the axle changes sides",
            ),
            Excludes(
                COURSE + " with [output] extension",
                "an end of the course",
                "that is singular at standstill: set arclength = true, or give neither cusps nor [reference] "
                "deceleration and creep",
            ),
            Excludes(COURSE, "a position that is no point", "a course begins at [x, y]"),
            Excludes(COURSE, "[reference] approach", "start the robot near the course"),
            Needs(COURSE, SCALAR, "emulated processors have no courses"),
            Excludes(COURSE, *NOT_IN_C),
            *only_simulated("[reference] course"),
        ),
    ),
    Stage(
        name="desired point",
        about="desired outputs of types I to III as functions of time: a position and a velocity, a circle, "
        "an oscillation",
        where=("[reference] position", "[reference] velocity", *IN_TIME),
        reads=(),
        writes=("reference",),
        rules=(
            *(
                Excludes(
                    f"[reference] {one}", others, "a desired point has one way to move: give one of them"
                )
                for one, others in (("circle", ("[reference] course", IN_TIME[1])), ("course", IN_TIME[1]))
            ),
            Needs(
                "[reference] position",
                (TIMED, COURSE, "[feedback]"),
                "type IV takes speed",
            ),
            Needs(TIMED, "[reference] position", "there is one for each output"),
            Needs("[reference] velocity", TIMED, "type IV takes speed"),
            Needs("[reference] circle", TIMED, "only a desired point moves on one"),
            Needs(
                "[reference] oscillation", "an output of the robot's own", "others have a circle or a course"
            ),
            *(
                Excludes(
                    f"[reference] {way}", "outputs that begin with no point", "give position and velocity"
                )
                for way in ("circle", "course")
            ),
            *(rule for way in IN_TIME for rule in only_simulated(way)),
        ),
    ),
    Stage(
        name="speed",
        about="the desired forward speed of type IV",
        where=("[reference] speed",),
        reads=("friction",),
        writes=("reference",),
        rules=(
            Needs("[reference] speed", '[output] type = "IV"', "other types take position"),
            Needs('[output] type = "IV"', ("[reference] speed", COURSE), "it is one of its outputs"),
        ),
    ),
    Stage(
        name="approach",
        about="desired outputs that go from where the robot is to their final values, with bounded "
        "accelerations",
        where=("[reference] approach",),
        reads=("seen", "reference"),
        writes=("reference",),
        module="noslip_approach.h",
        rules=(
            Excludes(
                "[reference] approach",
                '[drive] kind = "kinematic"',
                "most_acceleration bounds how the vehicle starts",
            ),
            Excludes("[reference] approach", "[output] extension", "its reference has no third derivative"),
            Needs("[reference] approach", SAMPLED, "it is advanced at the calls of the controller"),
            Excludes(
                "[reference] approach",
                "export --firmware",
                "a follower leads the distance alone, at the speed of the path",
            ),
            Excludes("[reference] approach", "outputs in another unit than m and rad", "leave it out"),
            Needs(
                "[reference] approach with an output in rad",
                "[reference.approach] angular",
                "give angular, in rad/s^2",
            ),
            Excludes("[reference.approach] angular", "outputs without an angle", "leave out angular"),
        ),
    ),
    Stage(
        name="commanded motion",
        about="lines, arcs and turns, or a course, as the motion of a robot with a state feedback",
        where=("[reference] commands",),
        reads=(),
        writes=("reference",),
        rules=(
            Needs(
                "[reference] commands",
                "[feedback]",
                "it is for robots with fewer inputs than degrees of freedom",
            ),
            Excludes(
                "[reference] commands",
                ("[reference] course", "[feedback] motion"),
                "commands begin and end at rest",
            ),
            Excludes("[feedback]", '[reference.course] follow = "path"', 'set follow = "time"'),
            Needs(
                "[feedback] with [reference] position",
                ("[reference] commands", "[reference] course"),
                "it is where these begin; give them, or leave it out",
            ),
            Excludes(
                "[feedback]",
                "a position of more than x, y and heading",
                "that is where commands or a course begin",
            ),
        ),
    ),
    Stage(
        name="integral action",
        about="the integral of the error of an output, added to its virtual input",
        where=("integral action (gain ki)",),
        reads=("seen", "reference", "status"),
        writes=("addition",),
        module="noslip_integral.h",
        columns=("integral_<OUTPUT>",),
        rules=(
            Needs(
                "integral action (gain ki) with [limits]",
                SAMPLED,
                "at each call, the status of the previous one decides whether the integral may grow",
            ),
        ),
    ),
    Stage(
        name="disturbance observer",
        about="an estimate of what disturbs an output, subtracted from its virtual input",
        where=("a disturbance observer (gain ko)",),
        reads=("seen", "reference", "status"),
        writes=("addition",),
        module="noslip_disturbance.h",
        columns=("disturbance_<OUTPUT>",),
        rules=(
            Needs("a disturbance observer (gain ko)", SAMPLED, "it compares what v did between two calls"),
            Excludes(
                "a disturbance observer (gain ko)",
                "[output] extension",
                "the derivative that it compares is not measured; give ki",
            ),
            Excludes(
                "a disturbance observer (gain ko)",
                '[drive] kind = "kinematic"',
                "a kinematic law commands velocities, it requires torques",
            ),
            Excludes(
                "a disturbance observer (gain ko)",
                '[drive] kind = "velocity" | "velocity+torque"',
                "v acts later than it is given",
            ),
            Excludes("a disturbance observer (gain ko)", *NOT_IN_FIRMWARE),
        ),
    ),
    Stage(
        name="law",
        about="input-output linearization of the outputs (12), (20), generated for the robot",
        where=("[output]",),
        reads=LAW_READS,
        writes=LAW_WRITES,
        module="noslip_controller.h",
        rules=(
            Needs(
                "a run",
                ("[output]", "[feedback]"),
                "a robot with fewer inputs than degrees of freedom takes the latter",
            ),
            Needs(
                "[output]",
                ("[initial]", "a composite path"),
                "[initial] is missing: point, heading and speed, or q and nu",
            ),
            Excludes(
                "an output of the robot's own",
                ("[output] L", "[output] W", "[output] path"),
                "its [output] type is not one of I, II, III, IV, which have these",
            ),
            Needs("[output] path", '[output] type = "IV"', "other types follow no path"),
            Needs('[output] type = "IV"', "[output] path", "its first output is the distance from it"),
            Needs("[output] parameters", "an output of the robot's own", "types I to IV have L, W and path"),
            Needs(
                "[output] L_backward",
                '[output] reversing = "switch"',
                "only then the side of the axle changes",
            ),
            Excludes("[output] W", *NOT_IN_FIRMWARE),
        ),
    ),
    Stage(
        name="damped law",
        about="type IV whose inverse is damped where the heading is nearly normal to the path",
        where=('[output] near_singular = "damped"',),
        reads=LAW_READS,
        writes=LAW_WRITES,
        rules=(
            Needs("[output] band", '[output] near_singular = "damped"', "it is where the inverse is damped"),
            Needs(
                '[output] near_singular = "damped"',
                '[output] type = "IV"',
                "only there the heading may be normal to a path",
            ),
            Excludes(
                '[output] near_singular = "damped"',
                ("[output] extension", COURSE, '[drive] kind = "kinematic"'),
                "accelerations are damped, without integrators, along one curve",
            ),
            Excludes('[output] near_singular = "damped"', "analyse --table", 'take near_singular = "refuse"'),
            Excludes('[output] near_singular = "damped"', *NOT_IN_FIRMWARE),
        ),
    ),
    Stage(
        name="dynamic extension",
        about="integrators on inputs, for a P_l on the axle",
        where=("[output] extension",),
        reads=LAW_READS,
        writes=LAW_WRITES,
        columns=("<EXTENSION>",),
        rules=(
            Excludes(
                "[output] extension",
                "a composite path",
                "P_l on the axle cannot follow a curvature that jumps; let a point follow a smooth curve, "
                "[reference] course",
            ),
            Excludes("[output] extension", *NO_REVERSING),
            Excludes("[output] extension", '[limits] mode = "slow" | "grip"', 'set mode = "cut"'),
            Excludes("[output] extension", VELOCITY, "use drives that take torques"),
            Excludes(
                "[output] extension", "analyse --table", "it is not supported here: see docs/extension.md"
            ),
        ),
    ),
    Stage(
        name="law along the way",
        about="type IV along a course, for a P_l on the axle, whose errors decay with the way "
        "instead of time",
        where=("[output] arclength",),
        reads=LAW_READS,
        writes=LAW_WRITES,
        rules=(
            Needs("[output] arclength", COURSE, 'it is for type IV with path = { kind = "course" }'),
            Excludes("[output] arclength", "[output] extension", "either makes a P_l on the axle regular"),
            Excludes("[output] arclength", *NO_REVERSING),
            Needs("[output] poles", "[output] arclength", "gains of other laws are in [gains]"),
        ),
    ),
    Stage(
        name="state feedback",
        about="an LQR about a steady motion, for a robot with fewer inputs than degrees of freedom",
        where=("[feedback]",),
        reads=("seen", "reference"),
        writes=("inputs", "status"),
        module="noslip_balance.h",
        rules=(
            Excludes(
                "[feedback]",
                (
                    *(
                        "[gains]",
                        "[given]",
                        "[correction]",
                        "[estimator]",
                        "[adaptation]",
                        "[drive]",
                        "[scene]",
                        "[output]",
                    ),
                    *(
                        f"[reference] {key}"
                        for key in ("speed", "lateral", "acceleration", "angular", "deceleration", "creep")
                    ),
                    *(f"[reference] {key}" for key in ("velocity", "approach", "circle", "oscillation")),
                ),
                "it takes commands, a course or its steady motion as reference",
            ),
            Excludes(
                "[feedback]",
                (
                    '[sensors] pose = "reckoned"',
                    "[sensors] counts",
                    "[sensors] gyro",
                    "[sensors] accelerometer",
                ),
                'there is no dead reckoning: [sensors] has noise, seed and period there, and pose = "true"',
            ),
            Excludes("[feedback]", '[limits] mode = "slow" | "grip"', 'give torque, and mode = "cut"'),
            Needs("[feedback] with [limits]", "[limits] torque", "its inputs are limited each"),
            Excludes("[feedback]", *NOT_IN_C),
            Excludes("[feedback]", "--record", "a record is of a law"),
            Excludes(
                "[feedback]", "noslip outer-loop", "its gains are those of an LQR, see docs/underactuated.md"
            ),
            Excludes(
                "[feedback]",
                "analyse --start",
                "starts are certified for laws of outputs; see noslip analyse ROBOT",
            ),
        ),
    ),
    Stage(
        name="friction",
        about="a part of mu is believed, which rises while driven wheels accelerate as expected, and falls "
        "where one runs away",
        where=('[limits] mode = "grip"',),
        reads=("seen", "inputs"),
        writes=("friction",),
        module="noslip_grip.h",
        columns=("believed_mu",),
        rules=(
            Needs("[limits] known", '[limits] mode = "grip"', "other modes do not use friction"),
            Bound("[limits] known", "[contact] mu", "more is never believed"),
        ),
    ),
    Stage(
        name="limits",
        about="inputs within their limits: each cut, or the vehicle slows down, or the wheels keep their "
        "grip too",
        where=("[limits]",),
        reads=("inputs", "friction"),
        writes=("inputs", "status"),
        module="noslip_grip.h",
        rules=(
            Excludes(
                '[drive] kind = "kinematic"',
                '[limits] mode = "cut" | "slow"',
                "most_speed and most_acceleration limit its commands",
            ),
            Excludes('[drive] kind = "kinematic"', "[limits] torque", "its law gives velocities"),
            Excludes(
                '[limits] mode = "slow"',
                ('[output] type = "I" | "II" | "III"', "[output] arclength"),
                'there is no speed to reduce: use another type IV, or mode = "cut"',
            ),
            Needs('[limits] mode = "grip"', "[contact]", "mu is the friction that the controller may use"),
            Needs(
                '[limits] mode = "cut" | "slow"',
                ("[limits] torque", "a limit of integral action or observers"),
                "it is what the mode keeps",
            ),
        ),
    ),
    Stage(
        name="drive",
        about="the drives take torques; or velocities, which their own loop of first order follows, with a "
        "torque or without",
        where=("[drive]",),
        reads=("given", "state"),
        writes=("force",),
        module="noslip_velocity.h",
        columns=("command_<VELOCITY>",),
        rules=(
            Needs(VELOCITY, SAMPLED, "commands are given at calls"),
            Needs(VELOCITY, "[drive] bandwidth", "it is that of the drives' own loop"),
            Excludes('[drive] kind = "velocity+torque" | "kinematic"', *NOT_IN_FIRMWARE),
            Needs(
                "export --firmware",
                ("[limits] torque", VELOCITY),
                "drives that take torques have a largest one",
            ),
            Excludes(
                VELOCITY,
                "fewer inputs than quasi-velocities",
                'not all of them can follow commands; take "torque"',
            ),
            Excludes(
                '[drive] kind = "torque"',
                ("[drive] bandwidth", "[drive] delay", "[drive] most_speed", "[drive] most_acceleration"),
                "the torque acts as given: leave it out, on the command line by --set "
                "'drive={kind=\"torque\"}'",
            ),
        ),
    ),
    Stage(
        name="delay",
        about="inputs act a time after the call that gave them",
        where=("[simulation] delay",),
        reads=("inputs",),
        writes=("given",),
        rules=(
            Bound(
                "[simulation] delay",
                "[simulation] period",
                "inputs act before the next call; a continuous loop has none",
            ),
        ),
    ),
    Stage(
        name="plant",
        about="the robot that rolls, with its true parameters, known functions of time and impulses",
        where=("a run", "[plant]", "[given]", "[[push]]"),
        reads=("force",),
        writes=("state",),
        columns=("t", "<STATE>", "<INPUT>", "lambda_<NUMBER>"),
        rules=(
            Needs("[[push]]", SAMPLED, "a continuous run has no impulses"),
            Excludes("[[push]]", *NOT_IN_C),
            Excludes(
                "[[push]]",
                "export --firmware",
                "the test of the firmware does not push the vehicle; leave it out",
            ),
            Excludes("[given]", *NOT_IN_C),
        ),
    ),
    Stage(
        name="floor",
        about="a floor with friction, bumps and slope in a physics engine, where wheels may slip",
        where=("--engine mujoco", "[floor]", "[scene]"),
        reads=("force",),
        writes=("state",),
        columns=("use_<CONTACT>", "slip_<CONTACT>", "load_<CONTACT>", "reckoned_<POSE>"),
        rules=(
            Needs("--engine mujoco", SAMPLED, "the controller is called as in firmware"),
            Excludes(
                "--engine mujoco with [scene]",
                "[[push]]",
                "it is along velocities that only the engine's own bodies have",
            ),
        ),
    ),
    Stage(
        name="contacts",
        about="what part of friction rolling without slip uses at each contact",
        where=("[contact]",),
        reads=("state", "force"),
        writes=(),
        columns=("use_<CONTACT>",),
    ),
    Stage(
        name="start and rows",
        about="where the run begins, when the controller is called, what is recorded and when it ends",
        where=("a run", "[initial]"),
        reads=("state", "config", "status"),
        writes=("outputs",),
        columns=("y<NUMBER>", "status"),
        rules=(
            Excludes(
                "[initial] state",
                tuple(f"[initial] {key}" for key in ("point", "heading", "speed", "q", "nu", "extension")),
                "it is relative to the desired state",
            ),
            Needs(
                "[initial] state", "[feedback]", "it is for robots with fewer inputs than degrees of freedom"
            ),
            *(
                Excludes(
                    f"[initial] {key}", ("[initial] q", "[initial] nu"), "give point, heading, speed or q, nu"
                )
                for key in ("point", "heading", "speed")
            ),
            Excludes(
                "[initial] point", "a robot that is no vehicle (moves_in_plane)", "give q and nu instead"
            ),
            Needs(
                "[initial]",
                ("[initial] point", "[initial] q", "[initial] state"),
                "give point = [x, y] or q = [...]",
            ),
            Bound(
                "[simulation] output_step",
                "[simulation] least_step",
                "there are too many rows; make it longer",
                sign=">=",
            ),
            Bound(
                SAMPLED,
                "[simulation] least_step",
                "the controller is called too often; make it longer",
                sign=">=",
            ),
            Needs("noslip sweep", SAMPLED, "a sweep runs sampled controllers; period = 0 is continuous"),
            Needs("noslip sweep", '[simulation] backend = "c" | "cf"', "a sweep runs the C"),
            Needs(
                "--record", '[simulation] backend = "m4f" | "rv32"', "only an emulated processor has a record"
            ),
            Needs(
                "noslip outer-loop with [output] path",
                '[output.path] kind = "line" | "circle" | "segment"',
                "on a path of another kind the curvature changes, and there is no steady motion",
            ),
            Needs("analyse --table", "[initial] point", "offsets are beside the start"),
            Needs("analyse --table", "[reference] speed", "speeds are relative to it"),
            Excludes(
                "analyse --table",
                ("[sensors]", "a composite path"),
                "the table is of one path and the true state",
            ),
        ),
    ),
)


def stages_of(spec: object, user: str = "") -> list[Stage]:
    """Return the stages in the loop of a SPEC, run by a user of it."""
    return [stage for stage in STAGES if any(Option(text).holds(spec, user) for text in stage.where)]


# What contradicts each other is said before what is missing.
RULES = tuple(
    sorted(
        (rule for stage in STAGES for rule in stage.rules),
        key=lambda r: (isinstance(r, Needs), r.option != "a run"),
    )
)


def broken(spec: object, user: str = "", law: ControlLaw | None = None) -> str:
    """Return which options of a SPEC do not go together, or with a `user` of it, one of USERS, or with its
    law, if that is known; an empty text if all do.
    """
    return next(filter(None, (rule.broken(spec, user, law) for rule in RULES)), "")


def check(spec: object, user: str = "", law: ControlLaw | None = None) -> None:
    """Raise BadInput where options are `broken`."""
    if problem := broken(spec, user, law):
        raise BadInput(problem)
