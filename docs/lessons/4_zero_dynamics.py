# %% [markdown]
# # Lesson 4: what the zero dynamics do in reverse
#
# The law keeps the point $P_l$ exactly on the line, and the speed exactly at the desired value. All errors
# are zero. And yet the robot turns across the line. This lesson says why, in 10 minutes; [how to run a
# lesson](README.md).
#
# ## What the outputs do not show
#
# $P_l$ is a distance $l = L + d$ ahead of the middle of the axle ($L$ ahead of the centre of mass, which is
# $d$ ahead of the axle; the drawing is in [lesson 3](3_cusps.py)). The axle moves along the heading at the
# speed $v$, so the velocity of $P_l$ across the line is $v\sin\theta + l\,\dot\theta\cos\theta$, where
# $\theta$ is the angle between heading and line. If the law keeps $P_l$ on the line, this is zero. Since
# $\dot\theta\cos\theta$ is the derivative of $\sin\theta$,
#
# $$\frac{d}{dt}\sin\theta = -\frac{v}{l}\,\sin\theta$$
#
# These are the *zero dynamics*: the motion that is left when the outputs are what they should be. No gain
# appears in them, so no gain can change them. Forward ($v/l > 0$) the angle decays, as a trailer straightens
# behind its tractor. In reverse it grows.

# %%
import matplotlib.pyplot as plt
import numpy as np
from noslip import simulate
from noslip.simulation.specification.vary import read_varied

# m: wheel radius, half the distance between the wheels, centre of mass ahead of the axle
R, B, D = 0.15, 0.75, 0.30


def drive(speed, theta, lookahead, duration=6.0):
    """A run of the generated C along the x-axis at a speed (m/s), from an angle theta (rad),
    with P_l on the line."""
    yaw_rate = -speed / lookahead * np.tan(theta)  # keeps P_l on the line
    changes = {
        "output": {"type": "IV", "L": lookahead - D, "path": {"kind": "line", "A": 0.0, "B": 1.0, "C": 0.0}},
        "reference.speed": speed,
        "initial": {
            "q": [0.0, float(-(lookahead - D) * np.sin(theta)), theta, 0.0, 0.0],
            "nu": [float(speed + B * yaw_rate) / R, float(speed - B * yaw_rate) / R],
        },
        "simulation.duration": duration,
    }
    return simulate(read_varied("line", changes))


figure, axes = plt.subplots(figsize=(6, 4), num="The angle to the line, forward and in reverse")
for label, speed in (("forward", 0.5), ("in reverse", -0.5)):
    run = drive(speed, theta=0.1, lookahead=0.5)
    theta = run.q[:, 2]
    print(
        f"{label}: distance of P_l at most {np.abs(run.error[:, 0]).max():.0e} m, status at the end: "
        f"{run.status[-1]}"
    )
    axes.plot(run.t, np.sin(theta), label=f"{label}, generated C")
    t = run.t[::25]
    formula = "formula" if speed > 0 else None
    axes.plot(t, np.sin(0.1) * np.exp(-speed / 0.5 * t), "o", markersize=3, color="#777777", label=formula)
axes.set(xlabel="t (s)", ylabel="sin of the angle to the line")
axes.legend()

# %% [markdown]
# The dots are $\sin\theta_0\,e^{-vt/l}$, where $\theta_0$ is the angle at the start. In reverse the run ends
# where $\sin\theta = 1$: the heading is normal to the line. There the decoupling matrix is singular and the C
# returns `NOSLIP_SINGULAR`. Until then the outputs have been perfect, but the yaw rate $\dot\theta =
# -\frac{v}{l}\tan\theta$ that this takes grows beyond all bounds, and with it the torques; on a real floor
# the wheels would slip long before. **Zero errors do not mean that all is well.**
#
# ## The remedy
#
# The sign of $v/l$ decides whether the angle decays. In reverse, choose a point *behind* the axle: $l < 0$.

# %%
run = drive(-0.5, theta=0.1, lookahead=-0.5)
print(f"angle at the end {run.q[-1, 2]:.1e} rad, status {run.status[-1]}")

# %% [markdown]
# noslip does this by itself where it is asked to: with `reversing = "switch"` in the `[output]` of a SPEC
# (the file that describes a run), and along paths with cusps, [in firmware too](../docs/paths.md).
#
# Before a run, `noslip analyse labmate --output type_iv_line` says what the zero dynamics will do:
#
# ```text
# at speed V    (L + d)*s' = -V*(s - (L + d)*chi); stable if and only if V*(L + d) > 0
# ```
#
# where $s$ is the sine of the angle and $\chi$ the curvature of the path, here 0: the equation above. (The
# line before it, *zero dynamics z3' = 0*, is the case in which all outputs are zero, the speed among them: a
# robot that stands does not turn.)
#
# ## Exercises
#
# 1. A robot reverses at 0.5 m/s with $l = 0.5$ m. At the start $P_l$ is on the line, and the heading is off
#    by one degree. When does the robot stand across the line?
# 2. Do larger gains help?
# 3. A tractor pulls a trailer, which is hitched at the middle of the tractor's axle. Both are to be driven in
#    reverse, and $P_l$ is chosen behind the axle of the tractor. What does the trailer do?
#
# <details><summary>Answers</summary>
#
# **1.** $\sin\theta_0\,e^{|v|t/|l|} = 1$, thus $t = \frac{|l|}{|v|}\,\log\frac{1}{\sin\theta_0}$.

# %%
theta = np.radians(1)
run = drive(-0.5, float(theta), lookahead=0.5)
print(
    f"predicted {np.log(1 / np.sin(theta)):.3f} s; the generated C stopped at {run.t[-1]:.3f} s: "
    f"{run.status[-1]}"
)

# %% [markdown]
# **2.** No. The gains act on the errors of the outputs, and these are zero. Only other outputs, or another
# $l$, change the zero dynamics.
#
# **3.** It jackknifes: it folds against the tractor. Its axle, at the distance $l_1$ from the hitch, can only
# roll, so that its heading $\varphi_1$ obeys $l_1\dot\varphi_1 = v\sin(\varphi - \varphi_1)$. Going forward
# the difference decays; in reverse, $v < 0$, it grows, whatever point of the tractor follows the path. It is
# one more part of the zero dynamics, and the outputs of the tractor do not show it.
# `noslip analyse tractor_trailer:1` says so.
#
# </details>
#
# Next: [lesson 5](5_grip.py), how much a floor has to hold.
