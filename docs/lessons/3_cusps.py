# %% [markdown]
# # Lesson 3: why trajectory tracking has cusps and path following none
#
# A robot starts at rest beside a line. In one experiment it *tracks a trajectory*: a point moves along the
# line, and the robot shall be where the point is. In the other it *follows the path*: it shall come to the
# line and drive along it at the same speed, wherever it then is. The lesson takes 10 minutes; [how to run a
# lesson](README.md).
#
# Both are loops of the generated C with the simulated LABMATE, figure 1 of the paper. What is controlled is a
# point $P_l$ of the platform, a distance $L$ ahead of the centre of mass $P_c$, which is a distance $d$ ahead
# of the middle of the axle, $P_o$ (here $L = 0$):
#
# ![The platform from above: P_o, P_c, P_l](../docs/notation.svg)
#
# The outputs differ. Tracking has the position $(x_l, y_l)$ of $P_l$ as outputs (the paper calls that Type
# I), path following the distance of $P_l$ from the line and the forward speed $v$ (Type IV).

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import noslip
import numpy as np
from noslip import simulate
from noslip.simulation.specification.vary import read_varied

SPECS = Path(noslip.__file__).parent / "examples/specs/figures"
R, D = 0.15, 0.30  # m, wheel radius, and distance of the centre of mass ahead of the axle


def track(speed, point=(0.0, 2.0)):
    """Type I: the desired point moves along y = x from (0, 0) at a speed, m/s;
    P_l starts at a point (m), facing along y."""
    velocity = [speed / 2**0.5] * 2
    changes = {"reference.velocity": velocity, "initial.point": list(point), "simulation.duration": 12.0}
    return simulate(read_varied(SPECS / "figure_1_type_i.toml", changes))


def follow(speed):
    """Type IV: along y = x at a speed, m/s."""
    changes = {"reference.speed": speed, "simulation.duration": 12.0}
    return simulate(read_varied(SPECS / "figure_1_type_iv.toml", changes))


def axle(run):
    """The way of the middle of the axle, m."""
    x, y, phi = run.q[:, 0], run.q[:, 1], run.q[:, 2]
    return x - D * np.cos(phi), y - D * np.sin(phi)


def forward_speed(run):
    """v, m/s: half the sum of the wheel rates, times the radius."""
    return R / 2 * run.nu.sum(axis=1)


figure, (above, near, over) = plt.subplots(
    1, 3, figsize=(12, 4), num="The way of the axle, its first decimetres, and the speed"
)
for label, run in (("tracks the trajectory", track(0.5)), ("follows the path", follow(0.5))):
    for axes in (above, near):
        axes.plot(*axle(run), label=label)
    over.plot(run.t, forward_speed(run), label=label)
for axes in (above, near):
    axes.plot(*(part[0] for part in axle(run)), "o", color="#333333")  # the start, the same for both
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
above.plot([0, 4], [0, 4], "--", color="#777777")
above.plot(0, 0, "s", color="#777777")
above.annotate("the moving point starts here", (0, 0), (0.6, 0.1), color="#555555", fontsize=9)
above.set_title("middle of the axle; dot: start")
near.set(xlim=(-0.1, 0.3), ylim=(1.55, 1.85), title="near the start: the cusp")
over.axhline(0, color="#777777", linewidth=1)
over.set(xlabel="t (s)", title="forward speed v (m/s)")
over.legend()
figure.tight_layout()

# %% [markdown]
# The robot that tracks first goes back by 10 cm, then forward: its way has a sharp point, a *cusp*. Look at
# the speed: **a cusp is where the forward speed changes its sign.** The middle of the axle always moves along
# the heading, because of the wheels (lesson 1). Its path is smooth as long as it moves; where $v$ passes
# through zero, it stops and leaves in the opposite direction.
#
# Why does this happen for Type I only?
#
# - Tracking asks for an acceleration of $P_l$ in *both* directions of the plane. The moving point starts at
#   $(0, 0)$, the robot at $(0, 2)$, ahead of it, and the law makes $P_l$ go back to meet it. $P_l$ itself
#   moves smoothly; but it is fixed to a robot that can only roll, so the axle must reverse. What $v$ does on
#   the way is nobody's concern: it is part of the result.
# - Path following makes $v$ an output of its own: $\dot v = k_v (v_d - v)$, with the gain $k_v$ and the
#   desired speed $v_d$. It rises from 0 to $v_d$ and never changes its sign. Where along the path the robot
#   is, is nobody's concern.
#
# The faster the desired point, the less there is to go back:


# %%
def cusps(run):
    """How often the forward speed changes its sign; the rest at the start does not count."""
    moving = forward_speed(run)[np.abs(forward_speed(run)) > 1e-4]
    return int(np.sum(moving[1:] * moving[:-1] < 0))


for speed in (0.5, 1.0, 1.414):
    both = [(cusps(run), forward_speed(run).min()) for run in (track(speed), follow(speed))]
    tracking, following = (f"{count} (smallest v {least + 0.0:.3f} m/s)" for count, least in both)
    print(f"{speed:5.3f} m/s: number of cusps tracking {tracking}, following {following}")

# %% [markdown]
# ## Exercises
#
# 1. The robot starts at $(-2, 0)$ instead of $(0, 2)$: as far from the line, but behind the moving point,
#    which starts at $(0, 0)$, instead of ahead of it. Is there a cusp at 0.5 m/s? Guess first.
# 2. A robot shall take boxes from a moving belt, another shall sweep a street. Which one tracks, which one
#    follows?
# 3. Are there paths that no robot on wheels can follow without a cusp?
#
# <details><summary>Answers</summary>
#
# **1.**

# %%
run = track(0.5, point=(-2.0, 0.0))
speed = forward_speed(run)
print(f"number of cusps {cusps(run)}; v between {speed.min():.2f} and {speed.max():.2f} m/s")

# %% [markdown]
# None: from behind, the robot only has to catch up, for which it drives at twice the speed of the point. For
# tracking, the start decides whether there is a cusp, and so do the speed and the gains.
#
# **2.** Who meets a belt must be at a place at a time, and tracks. Who sweeps a street must be on it, and
# follows: if something slows it down, it continues from where it is and need not hurry after a point that has
# gone on.
#
# **3.** Yes: if the path itself has one, as when parking. It is then part of the plan, the robot stands
# there, and the desired speed changes its sign. `noslip plan reeds-shepp` plans such paths, see [paths in
# firmware](../docs/paths.md).
#
# </details>
#
# Next: [lesson 4](4_zero_dynamics.py), what can go wrong although all errors are zero.
