# %% [markdown]
# # Lesson 5: what grip costs
#
# All lessons so far have assumed that no wheel slips. The ground must supply the forces for that, and it
# cannot supply more than friction allows. This lesson, of 15 minutes, says how much is asked for, and what it
# costs to ask for less; [how to run a lesson](README.md).
#
# ## The friction circle
#
# A wheel that carries the load $N$ rolls as long as the force along the ground is at most $\mu N$, in
# whatever direction. The *friction use* of a wheel is that force divided by $\mu N$: above 1 it would slip.
# On a circle of radius $\rho$ at the speed $v$ the robot needs the acceleration $v^2/\rho$ towards the
# centre. Assume that the two driven wheels carry all of its weight $mg$, half of it each (a castor keeps it
# level and carries nothing). Then the use should be $v^2/(\mu g \rho)$.

# %%
import matplotlib.pyplot as plt
import numpy as np
from noslip import simulate
from noslip.simulation.specification.vary import read_varied

MU, RADIUS, G = 0.3, 10.0, 9.81
# m: wheel radius, half the distance between the wheels, centre of mass ahead of the axle
R, B, D = 0.15, 0.75, 0.30


def drive(speed=3.0, beside=1.0, **changes):
    """A run of the generated C, called every 10 ms, along the circle about (20, 20). The robot starts on a
    circle about the same centre whose radius is larger by `beside`, m."""
    radius = RADIUS + beside
    yaw_rate, heading = speed / np.sqrt(radius**2 - D**2), np.pi / 2 - np.arcsin(D / radius)
    wheels = [float(speed + side * B * yaw_rate) / R for side in (1, -1)]
    settings = {
        "reference.speed": speed,
        "initial": {"q": [20.0 + radius, 20.0, float(heading), 0.0, 0.0], "nu": wheels},
    }
    settings |= {"contact.mu": MU, "simulation.period": 0.01, "simulation.duration": 15.0}
    return simulate(read_varied("circle", settings | changes))


def use(run):
    """The larger friction use of both wheels, at each time."""
    return np.max(list(run.use.values()), axis=0)


for speed in (2.0, 3.0, 4.0, 5.0):
    run = drive(speed, beside=0.0)
    print(
        f"{speed:g} m/s: friction use {use(run)[-1]:.3f}, v^2/(mu g rho) = {speed**2 / (MU * G * RADIUS):.3f}"
    )

# %% [markdown]
# The use grows with the square of the speed, as expected, but it is larger by the same factor each time:
# exercise 1.
#
# ## Getting onto the path
#
# On the path at 3 m/s all is well. The way to it is another matter. The robot starts 1 m outside the circle,
# and the law asks for an acceleration of $k_p \cdot 1$ m = 4 m/s² at once, however slippery the floor. Four
# ways to deal with this. The simulation lets the wheels roll whatever the use, and reports it:

# %%
WAYS = {
    "as it is (kp = 4)": {},
    "smaller gains (kp = 0.5)": {"gains": {"kp": 0.5, "kd": 1.5, "kv": 2.0}},
    "approach with 0.5 m/s^2": {"reference.approach": {"acceleration": 0.5}},
    "grip": {"limits": {"mode": "grip"}},
}
figure, (above, over) = plt.subplots(
    2, 1, figsize=(8, 6), sharex=True, num="Friction use and distance over time, for the four ways"
)
print(f"{'':26}largest use   within 5 cm after")
for label, changes in WAYS.items():
    run = drive(**changes)
    late = run.t[np.flatnonzero(np.abs(run.y[:, 0]) > 0.05)[-1]]
    print(f"{label:26}{use(run).max():11.2f} {late:15.2f} s")
    above.plot(run.t, use(run), label=label)
    over.plot(run.t, run.y[:, 0], label=label)
above.axhline(1, color="#333333", linewidth=1, linestyle="--")
above.set(ylabel="friction use", ylim=(0, 1.6), xlim=(0, 8))
above.set_title("above the dashed line a wheel would slip; the first way begins at 4", fontsize=10)
over.set(xlabel="t (s)", ylabel="distance (m)")
over.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
figure.tight_layout()

# %% [markdown]
# A use above 1 means that the wheels would slip and none of the equations would hold: on a floor the first
# way would not arrive as it does here. Smaller gains avoid that and are slow, at every error and for ever. An
# approach moves the desired distance to zero with a bounded acceleration: the gains stay, and with them the
# response to disturbances. (It is within 5 cm sooner than the first way, because it arrives without the long
# tail of an exponential. Its largest use is that of the small gains, because both begin with 0.5 m/s².) Grip
# changes the inputs only where they would make a wheel slip, and gives up the speed before the path (here it
# changes by 3 cm/s): see [keeping the wheels rolling](../docs/grip.md).
#
# ## Exercises
#
# 1. Why is the use in the table at the top larger than $v^2/(\mu g \rho)$? Predict it at 3 m/s. (The axle is
#    $d = 0.3$ m behind the centre of mass of the platform of 30 kg, the wheels of 1 kg each are $2b = 1.5$ m
#    apart. Both wheels give half of the side force. Think of three parts: the side force, its moment about
#    the axle, and what keeps the platform, ahead of the axle, on its own circle.)
# 2. Up to which speed do the wheels roll on this circle, at $\mu = 0.3$?
# 3. Does a heavier robot slip earlier?
#
# <details><summary>Answers</summary>
#
# **1.** Platform and wheels need the side force $F = m v \omega$ together. The platform, of the mass $m_c$,
# is a distance $d$ ahead of the axle and would turn the robot straight; the wheels balance this moment by
# pushing along with $\pm P$, forward at the outer wheel and backward at the inner one: $2 b P = d\,m_c v
# \omega$. The platform also turns about the middle of the axle, which takes the force $m_c d \omega^2$
# backward, half of it from each wheel. At the inner wheel both add, and it has the larger force,
# $\sqrt{(F/2)^2 + (P + m_c d \omega^2/2)^2}$.

# %%
m_c, m, speed = 30.0, 32.0, 3.0  # kg: platform, and with the wheels; m/s
yaw_rate = speed / np.sqrt(RADIUS**2 - D**2)
along = D * m_c * speed * yaw_rate / (2 * B) + m_c * D * yaw_rate**2 / 2
predicted = np.hypot(m * speed * yaw_rate / 2, along) / (MU * m * G / 2)
print(f"predicted {predicted:.4f}, simulated {use(drive(speed, beside=0.0))[-1]:.4f}")

# %% [markdown]
# **2.** Where the use is 1. It grows with the square of the speed, so that one run is enough.

# %%
limit = speed / np.sqrt(predicted)
for part in (0.99, 1.0, 1.01):
    print(f"{part * limit:.2f} m/s: use {use(drive(float(part * limit), beside=0.0))[-1]:.3f}")

# %% [markdown]
# **3.** No. The force that it needs and the load on its wheels both grow with the mass, which cancels. A load
# on castors is different: it takes weight off the driven wheels.
#
# </details>
#
# Next: [lesson 6](6_your_robot.py), your own robot.
