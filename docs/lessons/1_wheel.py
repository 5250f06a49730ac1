# %% [markdown]
# # Lesson 1: a wheel constrains velocity, not position
#
# A wheel cannot slip sideways. So how does a car get into a parking space beside it? This lesson takes about 15 minutes. You
# need vectors, derivatives and a little Python. The file is `docs/lessons/1_wheel.py`; run it cell by cell.
#
# ## One wheel
#
# Think of a unicycle from above: the point $(x, y)$ where the wheel touches the ground, and its heading $\varphi$. It can do
# two things: roll forward at a speed $v$, and turn on the spot at a rate $\omega$:
#
# $$\dot x = v\cos\varphi, \quad \dot y = v\sin\varphi, \quad \dot\varphi = \omega$$
#
# Whatever $v$ and $\omega$ are, the velocity has no component across the wheel:
#
# $$\dot x\sin\varphi - \dot y\cos\varphi = 0$$
#
# This is one equation for three velocities. Does it forbid any place?

# %%
import matplotlib.pyplot as plt
import numpy as np


def roll(pose, distance):
    """The pose (x, y, phi) after rolling forward by a distance, m."""
    x, y, phi = pose
    return np.array([x + distance * np.cos(phi), y + distance * np.sin(phi), phi])


def turn(pose, angle):
    """The pose after turning on the spot, rad to the left."""
    return pose + [0, 0, angle]


# %% [markdown]
# ## Parking
#
# Four moves: roll forward, turn left, roll back, turn right, all by the same number $\varepsilon$ (in metres, or in radians).
# The turns undo each other and so do the distances. Where is the wheel?


# %%
def four_moves(pose, e):
    """The poses after each of: forward, left, back, right."""
    poses = [pose]
    for move, size in ((roll, e), (turn, e), (roll, -e), (turn, -e)):
        poses.append(move(poses[-1], size))
    return poses


print("epsilon    x         y         phi    y / epsilon^2")
for e in (0.8, 0.4, 0.2, 0.1, 0.05):
    x, y, phi = four_moves(np.zeros(3), e)[-1]
    print(f"{e:5.2f}  {x:9.5f} {y:9.5f} {phi:7.1f} {y / e**2:12.4f}")

# %% [markdown]
# It stands beside the start, with its old heading: it has moved **sideways**, the one direction in which it cannot roll. The
# displacement is about $\varepsilon^2$ to the right: small moves give very little, which is why parking takes patience. (It
# also moves forward by about $\varepsilon^3/2$.) Repeating the four moves parks the wheel:

# %%
figure, (one, many) = plt.subplots(1, 2, figsize=(10, 3.6), num="Four moves and their displacement; ten times the same")


def draw_wheel(axes, pose, colour):
    """A wheel from above: a short line along its heading."""
    x, y, phi = pose
    axes.plot(x + 0.12 * np.cos(phi) * np.array([-1, 1]), y + 0.12 * np.sin(phi) * np.array([-1, 1]), color=colour, linewidth=3)


def draw_moves(axes, poses):
    """The way of the point of contact, and the wheel before and after."""
    axes.plot([p[0] for p in poses], [p[1] for p in poses], color="#1f5fa8", linewidth=1)
    draw_wheel(axes, poses[0], "#777777")
    draw_wheel(axes, poses[-1], "#b34700")
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")


pose = np.zeros(3)
poses = four_moves(pose, 0.6)
draw_moves(one, poses)
one.annotate("", poses[-1][:2], poses[0][:2], arrowprops={"arrowstyle": "->", "color": "#b34700"})
one.set_title("forward, left, back, right: the arrow is the bracket")
way = [pose]
for _ in range(10):
    way += four_moves(way[-1], 0.4)[1:]
draw_moves(many, way)
many.set_title("ten times, with epsilon = 0.4")

# %% [markdown]
# ## The bracket
#
# Rolling and turning are two vector fields on the space of poses $q = (x, y, \varphi)$: $f = (\cos\varphi, \sin\varphi, 0)$ and
# $g = (0, 0, 1)$. What is left of the four moves, divided by $\varepsilon^2$, tends to their Lie bracket
#
# $$[f, g] = \frac{\partial g}{\partial q} f - \frac{\partial f}{\partial q} g$$

# %%
import sympy

q = sympy.symbols("x y phi")
f = sympy.Matrix([sympy.cos(q[2]), sympy.sin(q[2]), 0])
g = sympy.Matrix([0, 0, 1])
bracket = g.jacobian(q) * f - f.jacobian(q) * g
print("[f, g] =", list(bracket))
print("rank of f, g, [f, g]:", sympy.Matrix.hstack(f, g, bracket).rank())

# %% [markdown]
# $[f, g] = (\sin\varphi, -\cos\varphi, 0)$ points to the right, across the wheel. Rolling, turning and the bracket together
# span all three directions, at every pose. The wheel therefore reaches **every** pose, in spite of its constraint. Such a
# constraint is called *nonholonomic*. It takes away a direction of motion, and no place.
#
# ## A constraint that does take away places
#
# If all brackets of the permitted vector fields stay within the permitted directions (the distribution is *involutive*), then
# motion stays on a surface: there is a function $c(q)$ that keeps its value, and the constraint is *holonomic*.
#
# A robot with two driven wheels has both kinds. The LABMATE has five coordinates: the position $(x_c, y_c)$ of its centre of
# mass, its heading $\varphi$, and the angles $\theta_r, \theta_l$ of its wheels. It has three constraints: no slip to the side,
# and each of the two wheels rolls. noslip computes the brackets exactly:

# %%
from noslip import analyse, find_robot

answer = analyse(find_robot("labmate"), ["type_i"]).constraints
print(f"{answer.m} constraints, {answer.k} of them holonomic")
print(answer.notes["integrals"][0])

# %% [markdown]
# No single one of the three can be integrated, but one combination can: the heading is $\varphi = \frac{r}{2b}(\theta_r -
# \theta_l) + \text{const}$. You can read the heading from the wheel angles, whatever way the robot has taken. Can you read the
# position as well? Let two robots turn their wheels by the same angles, in a different order:

# %%
r, b = 0.15, 0.75  # m, wheel radius and half the distance between the wheels


def wheels(turned_right, turned_left, steps=400):
    """The way of the middle of the axle, (x, y, phi), for wheel angles (rad) as functions of a number from 0 to 1."""
    s = np.linspace(0, 1, steps)
    right, left = np.diff(turned_right(s)), np.diff(turned_left(s))
    phi = np.concatenate([[0], np.cumsum(r / (2 * b) * (right - left))])
    middle, ahead = (phi[1:] + phi[:-1]) / 2, r / 2 * (right + left)
    x, y = (np.concatenate([[0], np.cumsum(ahead * part(middle))]) for part in (np.cos, np.sin))
    return x, y, phi


def first(s):
    """0 to 20 rad in the first half."""
    return 20 * np.minimum(2 * s, 1)


def second(s):
    """0 to 20 rad in the second half."""
    return 20 * np.maximum(2 * s - 1, 0)


figure, axes = plt.subplots(figsize=(5, 4), num="Two ways with the same wheel angles at the end")
for label, way in (("right wheel first", wheels(first, second)), ("left wheel first", wheels(second, first))):
    axes.plot(way[0], way[1], label=label)
    print(f"{label}: x = {way[0][-1]:.3f} m, y = {way[1][-1]:+.3f} m, phi = {abs(way[2][-1]):.3f} rad")
axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))

# %% [markdown]
# Same wheel angles, same heading, different places. A robot that counts the turns of its wheels knows its heading from the sums
# alone (as long as nothing slips). For its position it must integrate along the way, and errors add up: this is dead reckoning.
#
# In a closed loop of the generated C and the simulated robot the hidden integral keeps its value to rounding:

# %%
from noslip import read_spec, simulate

run = simulate(read_spec("circle"))
phi, right, left = run.q[:, 2], run.q[:, 3], run.q[:, 4]
hidden = phi - r / (2 * b) * (right - left)
print(f"heading turned by {phi[-1] - phi[0]:.2f} rad; phi - r (theta_r - theta_l)/(2b) changed by {np.ptp(hidden):.1e} rad")

# %% [markdown]
# ## Exercises
#
# 1. How often must you repeat the four moves with $\varepsilon = 0.3$ to park 1 m to the side?
# 2. Is $x\dot y - y\dot x = 0$ (for $x > 0$) holonomic?
# 3. A LABMATE starts with $\varphi = 0$ and both wheel angles at zero. Later $\theta_r - \theta_l = 20$ rad. What is its
#    heading? And what do you know about its position?
#
# <details><summary>Answers</summary>
#
# **1.** After rolling forward by $\varepsilon$ and turning, the wheel rolls back along the new heading: it moves by
# $-\varepsilon\sin\varepsilon$ to the side, exactly.

# %%
side = 0.3 * np.sin(0.3)
print(f"{side:.4f} m each time: {int(np.ceil(1 / side))} times")

# %% [markdown]
# **2.** Yes, although it is not the derivative of a function as it stands. Divided by $x^2$ it is: $\frac{d}{dt}\frac{y}{x} =
# \frac{x\dot y - y\dot x}{x^2} = 0$. The point stays on the ray through the origin on which it started. The constraint leaves a
# single vector field, $(x, y)$, and the bracket of a vector field with itself is zero: one field is always involutive.
#
# **3.** The heading is $\frac{r}{2b} \cdot 20$ rad:

# %%
print(f"{r / (2 * b) * 20:.2f} rad")

# %% [markdown]
# The position may be anything: that is what the two robots above have shown.
#
# </details>
#
# Words to remember: [Pfaffian constraint](../readers/glossary.md#constraint-pfaffian), [bracket](../readers/glossary.md#bracket),
# [involutive](../readers/glossary.md#distribution-involutive).
