"""The vehicle of firmware/ on this host, with its simulated board: its own C, called tick by tick."""

import math
import subprocess
from collections.abc import Callable
from pathlib import Path

import cffi
import numpy as np

from ..controllers.build import RUNTIME
from ..controllers.runtime import InC, load, without_bodies

ROOT = RUNTIME.parent
PERIOD = 0.01  # s, of firmware/robot.c
RUN, HOLD, STOP = range(3)  # states of the watchdog

LIBRARY = """
#include "board.h"
#include "clock.h"
#include "robot.h"

/* The simulated board, with a clock that does not wait and nobody to talk to; its memory is there to be looked at. */
#define SEMIHOSTING_WRITE0 0
static int semihosting(int operation, const void *argument) { return operation + (argument != 0); }
uint32_t late; /* ticks */
void clock_start(float period) { (void)period; }
uint32_t clock_wait(void) { return late; }
#define static
#include "simulated.h"
#undef static

int step_motor(const motor *self, float torque, float rate, float *told) { return motor_step(self, torque, rate, told); }

/* Drives laps of pieces, each so many ticks with so many counts of each wheel; answers how many ticks were refused. */
int drive_laps(vehicle *self, const int (*pieces)[3], int count, int laps)
{
    uint32_t at[2] = {0, 0};
    float told[2];
    int lap, piece, tick, refused = vehicle_step(self, at, 0, told) == NOSLIP_RANGE;
    for (lap = 0; lap < laps; lap++) {
        for (piece = 0; piece < count; piece++) {
            for (tick = 0; tick < pieces[piece][2]; tick++) {
                at[0] += (uint32_t)pieces[piece][0];
                at[1] += (uint32_t)pieces[piece][1];
                refused += vehicle_step(self, at, 0, told) == NOSLIP_RANGE;
            }
        }
    }
    return refused;
}
"""
OWN = """
int step_motor(const motor *self, float torque, float rate, float *told);
int drive_laps(vehicle *self, const int (*pieces)[3], int count, int laps);
int robot_settings(vehicle_settings *settings);
int board_start(float period); uint32_t board_wait(void); void board_read(uint32_t *counts); void board_drive(const float *told);
extern vehicle_settings robot;
extern float x, y, heading, rate[2], command[2];
extern uint32_t counter[2], late;
void move(float dt);
"""


def declarations(folder: Path, headers: dict[str, str]) -> str:
    """What vehicle.h declares, for cffi: preprocessed without the arithmetic below it and the bodies of functions."""
    (folder / "none").mkdir()
    for name in ("stdint.h", "stddef.h", "float.h"):
        (folder / "none" / name).write_text("")
    for name, text in headers.items():
        (folder / name).write_text(text)
    aside = ["-D__attribute__(x)=", "-Dstatic=", "-Dinline=", "-DNOSLIP_REAL_H", "-DNOSLIP_TRIG_H"]
    command = ["gcc", "-std=c99", "-E", "-P", "-nostdinc", *aside, f"-I{folder}/none", f"-I{RUNTIME}", "vehicle.h"]
    return without_bodies(subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout)


class Refused(Exception):
    """The settings cannot work; `status` is the name of what init answered."""

    def __init__(self, status: str):
        super().__init__(status)
        self.status = status


class Firmware(InC):
    """The firmware's C on this host: `ffi` knows its types, `lib` its functions."""

    def __init__(self, folder: Path, root: Path = ROOT):
        """`root`: of the tree that has the firmware and its law."""
        firmware, generated = root / "firmware", root / "generated/labmate"
        own = [firmware / f"{name}.{kind}" for name in ("vehicle", "motor", "watchdog", "robot") for kind in "ch"]
        own += [firmware / "board.h", *(firmware / "boards" / name for name in ("clock.h", "simulated.c"))]
        own += [generated / f"{name}.{kind}" for name in ("labmate_f", "labmate_type_iv_segment_f") for kind in "ch"]
        files = {path.name: path.read_text().replace('"../', '"') for path in own}
        simulated = files.pop("simulated.c").replace('#include "semihosting.h"\n', "")
        self.ffi = cffi.FFI()
        self.ffi.cdef(declarations(folder, {name: text for name, text in files.items() if name.endswith(".h")}) + OWN)
        self.lib = load(self.ffi, {**files, "simulated.h": simulated, "library.c": LIBRARY})

    def new(self, kind: str, *initial):
        return self.ffi.new(f"{kind} *", *initial)

    def used(self, kind: str):
        """A struct in memory that was used before: NaN in every number."""
        made = self.new(kind)
        self.ffi.buffer(made)[:] = b"\xff" * self.ffi.sizeof(kind)
        return made

    def settings(self):
        made = self.new("vehicle_settings")
        assert self.lib.robot_settings(made) == 0
        return made

    def vehicle(self, settings):
        made = self.used("vehicle")
        status = self.lib.vehicle_init(made, settings)
        if status != 0:
            raise Refused(self.status(status))
        return made

    def motor(self, **settings):
        """Answers the motor and the status of its init."""
        made = self.used("motor")
        return made, self.lib.motor_init(made, self.new("motor_settings", settings))


def way_to(place: str) -> tuple[str | int, ...]:
    """The way to a member: motors__0__supply is supply of the first of motors."""
    return tuple(int(part) if part.isdigit() else part for part in place.split("__"))


def change(settings, place: tuple, value) -> None:
    """Sets a member of a struct, named by the way to it."""
    *way, last = place
    for name in way:
        settings = settings[name] if isinstance(name, int) else getattr(settings, name)
    if isinstance(last, int):
        settings[last] = value
    else:
        setattr(settings, last, value)


class Loop:
    """The vehicle and the simulated board, tick by tick."""

    def __init__(self, c: Firmware, **changes):
        self.c, self.settings = c, c.settings()
        for place, value in changes.items():
            change(self.settings, way_to(place), value)
        self.vehicle = c.vehicle(self.settings)
        self.counts, self.command = c.ffi.new("uint32_t[2]"), c.ffi.new("float[2]")
        c.lib.board_start(self.settings.period)

    def tick(self, misread: Callable = lambda counts: None, missed: int = 0, told: bool = True) -> int:
        """Answers the status; what the counters show may be changed on the way, and missed ticks be kept from the vehicle."""
        self.c.lib.late = missed
        assert self.c.lib.board_wait() == missed
        self.c.lib.board_read(self.counts)
        misread(self.counts)
        status = self.c.lib.vehicle_step(self.vehicle, self.counts, missed if told else 0, self.command)
        self.c.lib.board_drive(self.command)
        return status

    def pose(self) -> np.ndarray:
        pose = self.vehicle.odometry.pose
        return np.array([pose.x, pose.y, pose.heading])

    def drift(self) -> float:
        """m: from the pose reckoned to the simulated vehicle's own."""
        ahead = self.settings.params.d * np.array([math.cos(self.c.lib.heading), math.sin(self.c.lib.heading)])
        return np.abs(self.pose()[:2] - ahead - (self.c.lib.x, self.c.lib.y)).max()

    @property
    def state(self) -> int:
        return self.vehicle.watchdog.state
