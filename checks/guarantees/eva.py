"""Frama-C's EVA: no undefined behaviour for any bit pattern of the arguments, and results as asserted.

Special floats are allowed (-warn-special-float none). An alarm is therefore an access outside an object, an
integer overflow, a conversion without a defined result, or an assertion in c/eva/*.c that EVA cannot prove.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

from .tools import HERE, STANDARD, Failed, Task, attempt, each, need, run

OPTIONS = (
    "-eva -eva-precision 1 -eva-auto-loop-unroll 40 "
    "-eva-no-print -machdep gcc_x86_32 -warn-special-float none -out-external -inout-verbose 1"
).split()
PROGRAMS = HERE / "c" / "eva"
SCALARS = {"float": ("_f", "0x1p-149f", "FLT_MAX", "_F"), "double": ("", "0x1p-1074", "DBL_MAX", "")}
GROUPED = re.compile(r"((?<=[{;])\s*){([^{}]*)}")  # members that Frama-C groups without a name
FILES = {"HEADER": "h", "SOURCE": "c"}
# Laws with a dynamic extension that are generated to be analysed
EXTENDED = ("type_i_extended", "type_iv_course_extended")
EXTENSION = {"law.extension", "law.extension_rate"}
RECKONED = {f"self.{member}" for member in ("now", "pose", "direction", "pending", "left", "steady")}
ESTIMATED = {f"self.filter.{member}" for member in ("state", "rounded", "factors")}
# what a law believes of friction
EARNED = {"law.ground", "law.grip", "law.earned.mu", "law.earned.pause"} | {
    f"law.wheel.{member}" for member in ("rate", "expected", "away", "steps")
}
# errno of sqrt, which is an instruction here; what the program of grip counts; what ANY depends on
NOT_OF_THE_C = {"__fc_errno", "kept", "Frama_C_entropy_source"}
MAY_WRITE = {  # function -> objects and members, named as in the programs, that it may write to
    "init": {"law"},
    "reset": {"law.held", "law.earned.pause"},
    "step": {"law.held", "tau", *EARNED},
    "follow": {"law.held", "tau", *EARNED},
    "output": {"all.h"},
    "rate": {"all.ydot"},
    "decoupling": {"all.Phi"},
    "decoupling_rate": {"all.Phidot"},
    "feedback": {"all.tau"},
    "evaluate": {"all"},
    "noslip_odometry_move": {*RECKONED, "pose"},
    "noslip_odometry_rates": {*RECKONED, "pose"},
    "noslip_odometry_correct": RECKONED,
    "noslip_odometry_unwind": RECKONED,
    "noslip_encoder_read": {"self.last", "self.started", "self.carry", "angle"},
    "labmate_ekf_tick": {"pose", "past", "self.filter.recorded", "self.filter.newest", *ESTIMATED},
    "noslip_ekf_correct": {f"self.filter.{member}" for member in ("nis", "rejected", "status")} | ESTIMATED,
    "noslip_integral_step": {"self.z", "self.rounded", "self.error", "self.added", "added"},
    "noslip_disturbance_step": {"self.estimate", "self.measured", "self.v", "self.begun", "added"},
    "noslip_velocity_step": {"self.command", "command"},
    "noslip_velocity_follow": {"self.command", "command"},
    "noslip_motor_step": {"command"},
    "noslip_motor_limit": {"torque"},
    "noslip_motor_set_supply": {"self.supply", "self.standing"},
    "noslip_watchdog_step": {
        f"self.{member}" for member in ("state", "reason", "status", "strikes", "good", "stood")
    },
    "noslip_telemetry_send": {"self.written", "self.dropped", "ring"},
    "noslip_telemetry_read": {"self.taken", "bytes", "count"},
    "noslip_image_save": {"image", "used"},
    "noslip_balance_step": {"tau"},
    "noslip_course_tracker_look": {"guide"},
    "noslip_course_tracker_update": {"tracker.now", "tracker.started", "guide"},
    "noslip_path_look": {"guide"},
    "noslip_path_update": {"self.current", "self.saved", "self.guide", "self.started", "guide"},
}
FOLLOWER_MAY_WRITE = {  # likewise in the program of the follower, whose parts are replaced; the objects only
    "labmate_follower_init": {"self"},
    "labmate_follower_tick": {"self", "command"},
    "labmate_follower_tick_angles": {"self", "command"},
    "labmate_follower_update": {"self"},
    "labmate_follower_correct": {"self"},
    "labmate_follower_reset": {"self"},
    "labmate_follower_twist": {"twist"},
}
# functions of which one interval says enough, so that no states are kept apart in them
MERGED = {"noslip_limit": 0, "noslip_abs": 0}
MERGED_IN_GRIP = {
    "noslip_within_cone": 0,
    "noslip_steps_within": 0,
    "noslip_earn": 0,
    "noslip_compare": 0,
    "noslip_shown": 0,
    "noslip_friction_ok": 0,
    "noslip_grip_init": 0,
}
# In the others, states with different segments must stay apart
MERGED_IN_PATH = (
    "sincos project end slow_down activate follow follow_extension restore switch set_remaining guide_copy "
    "path_finish"
).split()
MOST_IN_PATH = dict.fromkeys((f"noslip_{part}" for part in MERGED_IN_PATH), 0) | {
    "noslip_path_init": 200,
    "noslip_first_fault": 100,
    "noslip_path_look": 200,
    "noslip_path_update": 1000,
    "noslip_path_advance": 2000,
    "noslip_path_step": 2000,
    "check_init": 200,
    "check_update": 500,
    "main": 2000,
}
MOST_IN_DRIVES = {f"noslip_velocity_{part}": 0 for part in ("limit", "roll", "hold_curve", "within", "make")}
MOST_IN_COURSE = {f"noslip_course_{part}": 20 for part in ("place", "curvature", "direction", "bend", "add")}
# By what they return
COURSE_NOT_SPLIT = tuple(f"noslip_course_{part}" for part in ("ends", "cusp_ok", "backward", "left"))
MOST_IN_FOLLOWER = {"labmate_follower_init": 2000, "init_drives": 20, "set_params": 20} | dict.fromkeys(
    ("init_encoders", "init_path", "init_laws", "init_law", "init_approach", "init_integrals", "set_wheels"),
    0,
)
# The bytes are arbitrary
MOST_IN_FRAMES = {"noslip_crc32": 0, "noslip_frame_begin": 0, "noslip_frame_word": 20}


@dataclass(frozen=True)
class AnalysedProgram:
    """A program of c/eva/ for a law or the runtime, in one scalar."""

    source: str
    scalar: str
    law: str = ""

    def __str__(self) -> str:
        return " ".join(filter(None, [self.source, self.law])) + SCALARS[self.scalar][0]

    @property
    def extended(self) -> bool:
        """Whether the law has a dynamic extension: its step takes the time since the last one,
        and it is without friction."""
        return self.law.endswith("_extended")

    def precision(self, task: Task) -> list[str]:
        """Options for the number of states kept apart (slevel), and the functions with another number.

        Separate states are needed to distinguish limits that are absent and sizes that are infinite. The
        states at a return are split by the returned value; the value -1 is not a size, so that states of a
        size are not split.
        """
        suffix = SCALARS[self.scalar][0]
        of_frames = MOST_IN_FRAMES if self.source == "telemetry" else {}
        whole = {"path": MOST_IN_PATH, "drives": MOST_IN_DRIVES, "follower": MOST_IN_FOLLOWER}
        whole |= {"course": MOST_IN_COURSE, "tracker": MOST_IN_COURSE}
        own = whole.get(self.source, {})
        in_grip = MERGED_IN_GRIP if self.source in ("law", "grip") and task.grips(self.law) else {}
        most = MERGED | in_grip | own
        most = {
            f"{name}{suffix if name.startswith(('noslip', 'labmate')) else ''}": n for name, n in most.items()
        } | of_frames
        each = ",".join(f"{function}:{n}" for function, n in most.items())
        not_split = ("noslip_abs", *(COURSE_NOT_SPLIT if self.source in ("course", "tracker") else ()))
        kept = ",".join(f"{function}{suffix}:-1" for function in not_split)
        split = ["-eva-split-return", "full", "-eva-split-return-function", kept]
        levels = {
            "path": "100",
            "slip": "20",
            "course": "20",
            "tracker": "20",
            "telemetry": "300",
            "follower": "100",
        }
        level = levels.get(self.source, "2000")
        return ["-eva-slevel", level, "-eva-slevel-function", each, *split]

    def sources(self, task: Task) -> list[Path]:
        """The C files to analyse."""
        suffix = SCALARS[self.scalar][0]
        if self.source == "feedback":
            return [PROGRAMS / "feedback.c"]
        more = [task.law_file(f"{task.robot_of(self.law)}{suffix}.c")] if self.law else []
        more += [task.law_file(f"{self.law}{suffix}.c")] if self.source == "law" else []
        more += [task.runtime / f"noslip_path{suffix}.c"] if self.source == "path" else []
        more += (
            [task.generated / f"{name}{suffix}.c" for name in ("labmate", "labmate_ekf")]
            if self.source == "ekf"
            else []
        )
        more += [task.runtime / "noslip_watchdog.c"] if self.source in ("drives", "follower") else []
        if self.source == "telemetry":
            parts = [task.runtime / f"noslip_{part}.c" for part in ("telemetry", "image")]
            more = [task.generated / f"labmate_telemetry{suffix}.c", *parts]
        return [PROGRAMS / f"{self.source}.c", *more]

    def places(self, task: Task) -> list[str]:
        """The markers REACHED(...) in the program, all of which the analysis must reach."""
        text = (PROGRAMS / f"{self.source}.c").read_text(encoding="utf-8")
        if not (self.law and self.source != "feedback" and task.follows(self.law)):
            text = re.sub(r"#if FOLLOWS.*?#endif", "", text, flags=re.S)
        if self.extended:
            text = re.sub(r"#if !EXTENDED.*?#endif", "", text, flags=re.S)
        return re.findall(r"REACHED\((\w+)\)", text)

    def defined(self, task: Task) -> dict[str, str]:
        """The macros used by the programs: name -> replacement."""
        suffix, smallest, largest, upper = SCALARS[self.scalar]
        macros = {"SUFFIX": suffix, "REAL": self.scalar, "SMALLEST": smallest, "LARGEST": largest}
        macros |= {"ANGLE_MAX": f"NOSLIP_ANGLE_MAX{upper}"}
        if self.source == "telemetry":
            return macros | {"ROBOT": "labmate", "HEADER": f'"labmate_telemetry{suffix}.h"'}
        if self.source == "feedback":
            sizes = {size: f"{self.law.upper()}_{size}" for size in ("STATES", "INPUTS")}
            return macros | sizes | {"FEEDBACK": self.law, "HEADER": f'"{self.law}.h"'}
        if not self.law:
            return macros | {"HEADER": f'"labmate_ekf{suffix}.h"'}
        analysed = "labmate_follower" if self.source == "follower" else self.law
        law = {"ROBOT": task.robot_of(self.law), "LAW": self.law}
        law |= {name: f'"{analysed}{suffix}.{end}"' for name, end in FILES.items()}
        kind = {"FOLLOWS": task.follows(self.law), "EXTENDED": self.extended, "GRIPS": task.grips(self.law)}
        return macros | law | {name: str(int(holds)) for name, holds in kind.items()}


def programs(task: Task) -> list[AnalysedProgram]:
    """Return the programs to analyse; the short version has the last law, with `follow`,
    and all but the path, in float."""
    laws = task.laws[-1:] if task.short else task.laws
    scalars = ["float"] if task.short else list(SCALARS)
    parts = [
        ("runtime", ""),
        ("drives", ""),
        ("path", ""),
        ("slip", ""),
        ("ekf", ""),
        ("course", ""),
        ("tracker", ""),
    ]
    parts += [("balance", ""), ("telemetry", "")]
    # The first, without a speed, and the last, with follow
    grips = [("grip", law) for law in task.laws[:: len(task.laws) - 1]]
    named = [("law", law) for law in (*laws, *task.laws_of_others)]
    named += ([] if task.short else grips) + parts[: 2 if task.short else None]
    named += [("feedback", name) for name in task.feedback_names]
    named += [] if task.short else [("follower", task.laws[-1])]
    return [AnalysedProgram(source, scalar, law) for source, law in named for scalar in scalars]


def eva(task: Task) -> str:
    """Check that no program has an alarm or an unproved assertion,
    and that functions write only to permitted objects."""
    need("frama-c", "frama-c-base")
    if not task.short:
        task = replace(task, folder=task.folder / "eva", more=(*task.more, *EXTENDED))
    analyses = each(lambda program: analyse(task, program), programs(task))
    wrong = [line for _, lines in analyses for line in lines]
    if wrong:
        raise Failed("\n".join(wrong))
    return f"{len(analyses)} programs, {sum(shown for shown, _ in analyses)} assertions proved, 0 alarms"


def same_bits(task: Task) -> str:
    """Check that the C for Frama-C, which differs in six places (`__FRAMAC__`),
    has the same digest of all laws and paths."""
    need("gcc", "gcc")
    states, folder = "2000" if task.short else "20000", task.folder / "framac"
    folder.mkdir(parents=True, exist_ok=True)
    include, sources = (
        [*task.include, f"-I{task.root / 'tests/c'}"],
        [*task.sources, *task.lanes, task.root / "tests/c/law_digest.c"],
    )

    def digest(name: str, flags: list[str]) -> str:
        run(
            [
                "gcc",
                *STANDARD,
                "-O0" if task.short else "-O2",
                *flags,
                *include,
                *sources,
                "-lm",
                "-o",
                folder / name,
            ]
        )
        return run([folder / name, states, states])

    digests = each(lambda way: digest(*way), [("shipped", []), ("analysed", ["-D__FRAMAC__"])])
    if digests[0] != digests[1]:
        raise Failed(f"shipped:  {digests[0]}analysed: {digests[1]}")
    return f"one digest of {states} states"


def analyse(task: Task, program: AnalysedProgram) -> tuple[int, list[str]]:
    """Return the number of proved assertions, and a message for each that is not proved or not reached."""
    code, text = attempt(command(task, program))
    if code or (shown := re.search(r"Assertions +(\d+) valid +(\d+) unknown +(\d+) invalid", text)) is None:
        return 0, [f"{program}: frama-c ended with {code}", *text.splitlines()[-10:]]
    wrong = [
        f"{program}: {' '.join(each.split())}"
        for each in re.findall(r"\[eva:alarm\] (.*?)(?=\n\[|\n$|\Z)", text, re.S)
    ]
    if int(shown[2]) + int(shown[3]) and not wrong:
        wrong = [f"{program}: {shown[0]}"]
    if not re.search(r"^ +0 alarms generated", text, re.M) and not wrong:
        wrong = [f"{program}: alarms that are not listed"]
    reached = set(re.findall(r"Frama_C_show_each_reached_(\w+)", text))
    wrong += [f"{program}: {place} is not reached" for place in program.places(task) if place not in reached]
    whole = program.source == "follower"
    may_write = FOLLOWER_MAY_WRITE if whole else MAY_WRITE
    for function, written in re.findall(r"Out \(external\) for function (\w+):\n((?: +.*\n)+)", text):
        name = function.removeprefix(f"{program.law}_").removesuffix(SCALARS[program.scalar][0])
        allowed = may_write.get(name)
        if program.extended and name in ("step", "reset"):
            allowed = MAY_WRITE[name] | EXTENSION
        written = re.sub(r"\[[^]]*\]", "", written)
        while (
            plain := re.sub(r"([\w.]+){([^{}]*)}", _members, re.sub(GROUPED, r"\1\2", written))
        ) != written:
            written = plain
        places = set(re.findall(r"[A-Za-z_][\w.]*", written)) - NOT_OF_THE_C
        places = {place.split(".")[0] for place in places} if whole else places
        # An object stands for its members, which are listed where not all of them are written.
        if allowed is not None and any(not {place, *_objects(place)} & allowed for place in places):
            wrong.append(f"{program}: {function} writes to {' '.join(written.split())}")
    return int(shown[1]), wrong


def _objects(place: str) -> list[str]:
    """Return the objects that a member is in: law.link and law of law.link.m."""
    parts = place.split(".")
    return [".".join(parts[:k]) for k in range(1, len(parts))]


def _members(braced: re.Match[str]) -> str:
    """Return a{.b; .c} as a.b; a.c."""
    return "; ".join(braced[1] + member.strip() for member in braced[2].split(";"))


def command(task: Task, program: AnalysedProgram) -> list[str]:
    """Return the complete command line."""
    places = [
        *task.include,
        f"-I{PROGRAMS}",
        *(f"-D{name}={value}" for name, value in program.defined(task).items()),
    ]
    preprocess = " ".join(place.replace('"', '\\"') for place in places)
    options = [*OPTIONS, *program.precision(task), f"-cpp-extra-args={preprocess}"]
    return ["frama-c", *options, *map(str, program.sources(task))]
