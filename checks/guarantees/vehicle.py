"""The vehicle of firmware/ on this host: its C and the simulated board, called tick by tick."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...codegen.runtime import RUNTIME
from ...readers.files import write_folder
from ...simulation.controllers.runtime import InC, declarations, knowing, load

ROOT = RUNTIME.parent
PERIOD = 0.01  # s, of firmware/robot.c
RUN, HOLD, STOP = range(3)  # states of the watchdog

# of generated/labmate
LAW = (
    "labmate_f",
    "labmate_dynamics_f",
    "labmate_type_iv_segment_f",
    "labmate_follower_f",
    "labmate_telemetry_f",
)

LIBRARY = """
#include "board.h"
#include "clock.h"
#include "robot.h"

/* The simulated board, with a clock that does not wait and nobody to talk to; its memory is there to be
   looked at. */
enum { SEMIHOSTING_WRITE0, SEMIHOSTING_OPEN, SEMIHOSTING_WRITE, SEMIHOSTING_COMMAND_LINE };
static int semihosting(int operation, const void *argument) { return operation + (argument != 0); }
uint32_t late; /* ticks */
void clock_start(float period) { (void)period; }
uint32_t clock_wait(void) { return late; }
#define static
#include "simulated.h"
#undef static

/* Writes the frames of a tick and of a correction, as a program does. */
int tell(const labmate_follower_f *self, noslip_telemetry *to, const uint32_t *counts, uint32_t missed,
    int status,
         const float *command, float dt, const float *turned)
{
    noslip_record_f record;
    (void)labmate_follower_record_f(self, counts, missed, status, command, &record);
    record.dt = dt;
    record.turned[0] = turned[0];
    record.turned[1] = turned[1];
    return noslip_telemetry_record_f(to, &record);
}

int tell_correction(noslip_telemetry *to, const noslip_pose_f *truth, noslip_correction mode)
{
    return noslip_telemetry_correct_f(to, truth, mode);
}

/* Drives laps of pieces, each so many ticks with so many counts of each wheel; answers how many ticks were
   refused. */
int drive_laps(labmate_follower_f *self, const int (*pieces)[3], int count, int laps)
{
    uint32_t at[2] = {0, 0};
    float command[2];
    int lap, piece, tick, refused = labmate_follower_tick_f(self, at, 0, command) == NOSLIP_RANGE;
    for (lap = 0; lap < laps; lap++) {
        for (piece = 0; piece < count; piece++) {
            for (tick = 0; tick < pieces[piece][2]; tick++) {
                at[0] += (uint32_t)pieces[piece][0];
                at[1] += (uint32_t)pieces[piece][1];
                refused += labmate_follower_tick_f(self, at, 0, command) == NOSLIP_RANGE;
            }
        }
    }
    return refused;
}
"""
OWN = """
int tell(const labmate_follower_f *self, noslip_telemetry *to, const uint32_t *counts, uint32_t missed,
    int status,
         const float *command, float dt, const float *turned);
int tell_correction(noslip_telemetry *to, const noslip_pose_f *truth, noslip_correction mode);
int drive_laps(labmate_follower_f *self, const int (*pieces)[3], int count, int laps);
int robot_config(labmate_follower_config_f *settings);
int board_start(float period); uint32_t board_wait(void); void board_read(uint32_t *counts);
void board_drive(const float *command);
extern labmate_follower_config_f robot;
extern float x, y, heading, rate[2], command[2];
extern uint32_t counter[2], late;
void move(float dt);
"""


class SettingsRefused(Exception):
    """The settings are rejected; `status` is the name of the status that init returned."""

    def __init__(self, status: str):
        super().__init__(status)
        self.status = status


class Firmware(InC):
    """The C of the firmware on this host: `ffi` has its types, `lib` its functions."""

    def __init__(self, folder: Path, root: Path = ROOT):
        """`root`: the source tree with the firmware and its law."""
        firmware, generated = root / "firmware", root / "generated/labmate"
        own = [firmware / f"{name}.{kind}" for name in ("robot",) for kind in "ch"]
        own += [firmware / "board.h", *(firmware / "boards" / name for name in ("clock.h", "simulated.c"))]
        own += [generated / f"{name}.{kind}" for name in LAW for kind in "ch"]
        files = {path.name: path.read_text(encoding="utf-8").replace('"../', '"') for path in own}
        simulated = files.pop("simulated.c").replace('#include "semihosting.h"\n', "")
        write_folder(folder / "headers", {name: text for name, text in files.items() if name.endswith(".h")})
        self.ffi = knowing(declarations("labmate_telemetry_f.h", folder / "headers") + OWN)
        self.lib = load(self.ffi, {**files, "simulated.h": simulated, "library.c": LIBRARY})

    def new(self, kind: str, *initial):
        return self.ffi.new(f"{kind} *", *initial)

    def used(self, kind: str):
        """Return a struct with NaN in every number, as in memory that was used before."""
        made = self.new(kind)
        self.ffi.buffer(made)[:] = b"\xff" * self.ffi.sizeof(kind)
        return made

    def settings(self):
        made = self.new("labmate_follower_config_f")
        assert self.lib.robot_config(made) == 0
        return made

    def vehicle(self, settings):
        made = self.used("labmate_follower_f")
        status = self.lib.labmate_follower_init_f(made, settings)
        if status != 0:
            raise SettingsRefused(self.status(status))
        return made


def member_path(place: str) -> tuple[str | int, ...]:
    """Return the members and indices in a name: motors__0__supply is the supply of the first motor."""
    return tuple(int(part) if part.isdigit() else part for part in place.split("__"))


def change(settings, place: tuple, value) -> None:
    """Set a member of a struct, given the path to it."""
    *path, last = place
    for name in path:
        settings = settings[name] if isinstance(name, int) else getattr(settings, name)
    if isinstance(last, int):
        settings[last] = value
    else:
        setattr(settings, last, value)


class FirmwareLoop:
    """The vehicle and the simulated board, tick by tick."""

    def __init__(self, c: Firmware, **changes):
        self.c, self.settings = c, c.settings()
        for place, value in changes.items():
            change(self.settings, member_path(place), value)
        self.vehicle = c.vehicle(self.settings)
        self.counts, self.command = c.ffi.new("uint32_t[2]"), c.ffi.new("float[2]")
        c.lib.board_start(self.settings.period)

    def tick(self, misread: Callable = lambda counts: None, missed: int = 0, reported: bool = True) -> int:
        """Run a tick and return its status; `misread` changes the counters,
        and missed ticks can be hidden from the vehicle."""
        self.c.lib.late = missed
        assert self.c.lib.board_wait() == missed
        self.c.lib.board_read(self.counts)
        misread(self.counts)
        status = self.c.lib.labmate_follower_tick_f(
            self.vehicle, self.counts, missed if reported else 0, self.command
        )
        self.c.lib.board_drive(self.command)
        return status

    def pose(self) -> np.ndarray:
        pose = self.vehicle.odometry.pose
        return np.array([pose.x, pose.y, pose.heading])

    def drift(self) -> float:
        """Distance between the estimated and the true position of the simulated vehicle, m."""
        ahead = self.settings.params.d * np.array(
            [math.cos(self.c.lib.heading), math.sin(self.c.lib.heading)]
        )
        return np.abs(self.pose()[:2] - ahead - (self.c.lib.x, self.c.lib.y)).max()

    @property
    def state(self) -> int:
        return self.vehicle.watchdog.state
