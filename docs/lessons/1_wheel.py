# %% [markdown]
# # Lesson 1: a wheel constrains velocity, not position
#
# A wheel cannot slip sideways. So how does a car get into a parking space beside it? This lesson takes about
# 15 minutes, and 10 more with its exercises. You need vectors, derivatives and a little Python; [how to run a
# lesson](README.md).
#
# ## One wheel
#
# Think of a unicycle from above: the point $(x, y)$ where the wheel touches the ground, and its heading
# $\varphi$. The three together are its *pose*. It can do two things: roll forward at a speed $v$, and turn on
# the spot at a rate $\omega$:
#
# $$\dot x = v\cos\varphi, \quad \dot y = v\sin\varphi, \quad \dot\varphi = \omega$$
#
# Whatever $v$ and $\omega$ are, the velocity has no component across the wheel:
#
# $$\dot x\sin\varphi - \dot y\cos\varphi = 0$$
#
# This is one equation for three velocities, a constraint. Does it forbid any pose?

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
# Four moves: roll forward, turn left, roll back, turn right, all by the same number $\varepsilon$ (in metres,
# or in radians). The turns undo each other and so do the distances. Where is the wheel? (A unicycle could
# also turn by 90 degrees and roll; a car cannot. What *small* moves give carries over to every vehicle.)


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
# It stands beside the start, with its old heading: it has moved **sideways**, the one direction in which it
# cannot roll. The displacement is about $\varepsilon^2$ to the right: small moves give very little, which is
# why parking takes patience. (It also moves forward, by about $\varepsilon^3/2$.) Repeating the four moves
# parks the wheel:

# %%
figure, (one, many) = plt.subplots(
    1, 2, figsize=(10, 4.4), num="Four moves and their displacement; ten times the same"
)


def draw_wheel(axes, pose, colour, length=0.12):
    """A wheel from above: a short line along its heading, and a dot at its front."""
    x, y, phi = pose
    along = length * np.array([np.cos(phi), np.sin(phi)])
    axes.plot([x - along[0], x + along[0]], [y - along[1], y + along[1]], color=colour, linewidth=3)
    axes.plot(x + along[0], y + along[1], "o", markersize=4, color=colour)


def draw_moves(axes, poses):
    """The way of the point of contact, and the wheel before and after."""
    axes.plot([p[0] for p in poses], [p[1] for p in poses], color="#1f5fa8", linewidth=1)
    draw_wheel(axes, poses[0], "#777777")
    draw_wheel(axes, poses[-1], "#b34700")
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")


pose = np.zeros(3)
poses = four_moves(pose, 0.6)
draw_moves(one, poses)
draw_wheel(one, poses[2], "#bbbbbb")
one.annotate("", poses[-1][:2], poses[0][:2], arrowprops={"arrowstyle": "->", "color": "#b34700"})
for text, place in (
    ("1 forward", (0.22, 0.03)),
    ("2 left", (0.72, 0.06)),
    ("3 back", (0.4, -0.2)),
    ("4 right", (0.26, -0.35)),
):
    one.text(*place, text)
one.set(xlim=(-0.2, 0.95), ylim=(-0.45, 0.2), title="arrow: what the four moves leave")
way = [pose]
for _ in range(10):
    way += four_moves(way[-1], 0.4)[1:]
draw_moves(many, way)
many.set_title("ten times, with epsilon = 0.4")

# %% [markdown]
# ## The bracket
#
# Rolling and turning are two vector fields on the space of poses $q = (x, y, \varphi)$: $f = (\cos\varphi,
# \sin\varphi, 0)$ and $g = (0, 0, 1)$. The wheel rolls forward along $f(q)$, turns, and rolls back along
# $f(q + \varepsilon g)$, which is about $f + \varepsilon\frac{\partial f}{\partial q} g$, where
# $\frac{\partial f}{\partial q}$ is the Jacobian matrix. What is left of rolling there and back is
# $-\varepsilon^2\frac{\partial f}{\partial q} g$. Turning there and back leaves $+\varepsilon^2\frac{\partial
# g}{\partial q} f$ in the same way. The sum, divided by $\varepsilon^2$, tends to their *Lie bracket*
#
# $$[f, g] = \frac{\partial g}{\partial q} f - \frac{\partial f}{\partial q} g$$

# %%
import sympy

q = sympy.symbols("x y phi")
f = sympy.Matrix([sympy.cos(q[2]), sympy.sin(q[2]), 0])
g = sympy.Matrix([0, 0, 1])
bracket = g.jacobian(q) * f - f.jacobian(q) * g
print("[f, g] =", list(bracket))
print("determinant of f, g, [f, g]:", sympy.simplify(sympy.Matrix.hstack(f, g, bracket).det()))

# %% [markdown]
# $[f, g] = (\sin\varphi, -\cos\varphi, 0)$ points to the right, across the wheel; at $\varphi = 0$ its $-1$
# is the limit of the last column above. The determinant is never zero: rolling, turning and the bracket span
# all three directions, at every pose. A theorem of Chow says that the wheel then reaches **every** pose, in
# spite of its constraint.
#
# Such a constraint is called *nonholonomic*: it takes away a direction of motion, and no pose. The other kind
# is *holonomic*: it can be written as $\frac{d}{dt} c(q) = 0$, so that a function $c$ of the pose keeps its
# value, and takes away poses as well.
#
# ## A constraint that does take away poses
#
# A robot with two driven wheels has both kinds. The LABMATE, a platform of the year 1992 that these lessons
# use throughout, has five coordinates: the position $(x_c, y_c)$ of its centre of mass, its heading
# $\varphi$, and the angles $\theta_r, \theta_l$ of its right and its left wheel. Its wheels have the radius
# $r$ and are $2b$ apart. It has three constraints. The axle does not slip to the side, as above, and each
# wheel rolls ($v$ is the speed of the middle of the axle):
#
# $$r\,\dot\theta_r = v + b\,\dot\varphi, \qquad r\,\dot\theta_l = v - b\,\dot\varphi$$
#
# Neither is the derivative of a function of the coordinates. But subtract them: $\dot\varphi =
# \frac{r}{2b}(\dot\theta_r - \dot\theta_l)$ is. Counting says the same. Five coordinates with three
# constraints leave two permitted vector fields; their brackets add a third and a fourth direction, but never
# the fifth. What is then closed under brackets is called *involutive*, and the missing direction is a
# function that cannot change. noslip computes the brackets exactly:

# %%
from noslip import analyse, find_robot

answer = analyse(find_robot("labmate"), ["type_i"]).constraints
print(f"{answer.m} constraints, {answer.k} of them holonomic; directions with brackets: {answer.growth}")
print("keeps its value up to a constant:", answer.notes["integrals"][0])

# %% [markdown]
# So $\varphi = \frac{r}{2b}(\theta_r - \theta_l) + \text{const}$: you can read the heading from the wheel
# angles, whatever way the robot has taken. Can you read the position as well? Let two robots turn their
# wheels by the same angles, in a different order:

# %%
r, b = 0.15, 0.75  # m, wheel radius and half the distance between the wheels


def wheels(order, angle=20.0, steps=200):
    """The poses of the middle of the axle while the wheels turn by an angle (rad) each,
    one after the other."""
    poses = [np.zeros(3)]
    for wheel in order:
        for _ in range(steps):
            right, left = (angle / steps, 0.0) if wheel == "right" else (0.0, angle / steps)
            arc, bend = r / 2 * (right + left), r / (2 * b) * (right - left)  # m along, rad of heading
            pose = turn(roll(turn(poses[-1], bend / 2), arc), bend / 2)
            poses.append(pose)
    return poses


figure, axes = plt.subplots(
    figsize=(6, 4), num="Two ways with the same wheel angles at the end, and the headings there"
)
for order, colour in ((("right", "left"), "#1f5fa8"), (("left", "right"), "#b34700")):
    poses = wheels(order)
    axes.plot([p[0] for p in poses], [p[1] for p in poses], color=colour, label=f"{order[0]} wheel first")
    draw_wheel(axes, poses[-1], colour)
    x, y, phi = poses[-1]
    print(f"{order[0]} wheel first: x = {x:.3f} m, y = {y:+.3f} m, phi = {abs(phi):.3f} rad")
axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))

# %% [markdown]
# Same wheel angles, same heading, different places. A robot that counts the turns of its wheels knows its
# heading from the total wheel angles alone (as long as nothing slips). For its position it must add up small
# steps along the way, and their errors add up too: this is *dead reckoning*.
#
# Nobody has put the fact about the heading into a simulation: it is hidden in the constraints. In the run
# `circle` that comes with noslip a controller (lesson 2) drives the LABMATE onto a circle. The hidden
# function keeps its value to rounding:

# %%
from noslip import read_spec, simulate

run = simulate(read_spec("circle"))
phi, right, left = run.q[:, 2], run.q[:, 3], run.q[:, 4]
hidden = phi - r / (2 * b) * (right - left)
print(
    f"heading turned by {phi[-1] - phi[0]:.2f} rad; phi - r (theta_r - theta_l)/(2b) changed by "
    f"{np.ptp(hidden):.1e} rad"
)

# %% [markdown]
# ## Exercises
#
# 1. How often must you make the four moves with $\varepsilon = 0.3$ to park at least 1 m to the side?
# 2. A point in the plane, $q = (x, y)$ with $x > 0$, has the constraint $x\dot y - y\dot x = 0$. Is it
#    holonomic?
# 3. A LABMATE starts with $\varphi = 0$ and both wheel angles at zero. Later $\theta_r - \theta_l = 20$ rad.
#    What is its heading? And what do you know about its position?
#
# <details><summary>Answers</summary>
#
# **1.** After rolling forward by $\varepsilon$ and turning, the wheel rolls back along the new heading: it
# moves by $-\varepsilon\sin\varepsilon$ to the side, exactly.

# %%
side = 0.3 * np.sin(0.3)
times, ahead = int(np.ceil(1 / side)), 0.3 * (1 - np.cos(0.3))
print(f"{side:.4f} m each time: {times} times. It also moves forward, by {times * ahead:.2f} m in all")

# %% [markdown]
# **2.** Yes, although it is not the derivative of a function as it stands. Divided by $x^2$ it is:
# $\frac{d}{dt}\frac{y}{x} = \frac{x\dot y - y\dot x}{x^2} = 0$. The point stays on the ray through the origin
# on which it started. The constraint leaves a single vector field, $(x, y)$, and the bracket of a vector
# field with itself is zero: one field is always involutive.
#
# **3.** The heading is $\frac{r}{2b} \cdot 20$ rad:

# %%
print(f"{r / (2 * b) * 20:.2f} rad")

# %% [markdown]
# Nothing about the position. The difference does not even tell how far the robot went; and if both angles are
# known, as for the two robots above, the order still matters.
#
# </details>
#
# Words to remember: [Pfaffian constraint](../readers/glossary.md#constraint-pfaffian) (all constraints above
# are: linear in the velocities), [bracket](../readers/glossary.md#bracket),
# [involutive](../readers/glossary.md#distribution-involutive).
#
# Next: [lesson 2](2_lagrangian_to_c.py), from the robot to the C of its controller.
