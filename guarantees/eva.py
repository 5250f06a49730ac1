"""Frama-C's EVA: no undefined behaviour for any bit pattern of the arguments, and results as asserted.

Special floats are allowed (-warn-special-float none). An alarm is therefore an access outside an object, an integer overflow, a
conversion without a defined result, or an assertion in c/eva/*.c that EVA cannot prove.
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
EXTENDED = ("type_i_extended", "type_iv_course_extended")  # laws with a dynamic extension that are generated to be analysed
EXTENSION = {"law.extension", "law.extension_rate"}
RECKONED = {f"self.{member}" for member in ("now", "pose", "direction", "pending", "left", "steady")}
ESTIMATED = {f"self.filter.{member}" for member in ("state", "rounded", "factors")}
# errno of sqrt, which is an instruction here; what the program of grip counts; what ANY depends on
NOT_OF_THE_C = {"__fc_errno", "kept", "Frama_C_entropy_source"}
MAY_WRITE = {  # function -> objects and members, named as in the programs, that it may write to
    "init": {"law"},
    "reset": {"law.held"},
    "step": {"law.held", "tau"},
    "follow": {"law.held", "tau"},
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
    "noslip_watchdog_step": {f"self.{member}" for member in ("state", "reason", "status", "strikes", "good", "stood")},
    "noslip_telemetry_send": {"self.written", "self.dropped", "ring"},
    "noslip_telemetry_read": {"self.taken", "bytes", "count"},
    "noslip_image_save": {"image", "used"},
    "noslip_course_tracker_look": {"guide"},
    "noslip_course_tracker_update": {"tracker.now", "tracker.started", "guide"},
