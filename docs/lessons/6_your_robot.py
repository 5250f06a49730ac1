# %% [markdown]
# # Lesson 6: your own robot
#
# How does one write down a robot that nobody has written down before, and notice the mistakes? This lesson,
# of 25 minutes, does it for an articulated roller: a front body and a rear body with one rigid axle each, and
# a joint between them that a motor turns; [how to run a lesson](README.md).
#
# ## Four questions
#
# 1. *What moves?* The middle of the front axle $(x, y)$, the heading $\varphi$ of the front body, and the
#    angle $\gamma$ of the joint. The rear body has the heading $\varphi + \gamma$. That is $n = 4$.
# 2. *What cannot move?* Neither axle slips to the side: $m = 2$ constraints, so that $n - m = 2$ velocities
#    are free.
# 3. *What has energy?* Each body moves and turns. Write the place of its centre of mass; noslip
#    differentiates it.
# 4. *What acts?* A force that pushes the front axle forward, and a torque in the joint. As many inputs as
#    free velocities.
#
# Nothing else is needed. In particular nobody solves for the motion of the rear body: that follows.

# %%
import matplotlib.pyplot as plt
import numpy as np
from casadi import SX, Function, cos, sin, vertcat
from noslip import Mechanism, analyse, control_law, make_controller, output_map, reduce

A, C = 1.0, 0.8  # m: joint behind the front axle, rear axle behind the joint


def draw(axes, gamma):
    """The roller from above, its front axle at the origin and heading along x,
    with the centre of its circle."""
    joint, rear = np.array([-A, 0.0]), np.array([-A - C * np.cos(gamma), -C * np.sin(gamma)])
    centre = np.array([0.0, rear[1] + (rear[0] / np.tan(gamma))])  # on the lines of both axles
    for start, end in ((np.zeros(2), joint), (joint, rear)):
        axes.plot(*np.transpose([start, end]), color="#333333", linewidth=2)
    for place, angle in ((np.zeros(2), 0.0), (rear, gamma)):
        across = 0.4 * np.array([-np.sin(angle), np.cos(angle)])
        axes.plot(*np.transpose([place - across, place + across]), color="#1f5fa8", linewidth=4)
        axes.plot(*np.transpose([place, centre]), "--", color="#999999", linewidth=1)
    axes.plot(*joint, "o", color="#b34700")
    axes.plot(*centre, "x", color="#333333")
    for text, place in (
        ("front axle (x, y)", (0.1, 0.1)),
        ("joint", (-1.0, 0.12)),
        ("rear axle", rear + [-1.1, -0.1]),
        ("centre", centre),
    ):
        axes.annotate(text, place, xytext=(4, 4), textcoords="offset points")
    axes.annotate("a", (-A / 2, 0.08)), axes.annotate("c", (joint + rear) / 2 + [0.0, -0.25])
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)", xlim=(-2.9, 1.6), ylim=(centre[1] - 0.4, 0.7))


figure, axes = plt.subplots(figsize=(5, 4.5), num="The roller from above, with its joint at gamma = 0.6 rad")
draw(axes, 0.6)


# %% [markdown]
# The model, in the order of the four questions:


# %%


def roller(sign=1):
    """The roller; with `sign` = -1 there is a mistake in it."""
    robot = Mechanism("roller", "two bodies with an axle each, steered by the joint between them")
    x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
    gamma = robot.coordinate("gamma", "rad", "rear body relative to the front body")
    a, c = (
        robot.parameter("a", A, "m", "joint behind the front axle"),
        robot.parameter("c", C, "m", "rear axle behind the joint"),
    )
    m_f, m_r = (
        robot.parameter("m_f", 1200.0, "kg", "front body"),
        robot.parameter("m_r", 900.0, "kg", "rear body"),
    )
    I_f, I_r = (
        robot.parameter("I_f", 400.0, "kg m^2", "front body"),
        robot.parameter("I_r", 250.0, "kg m^2", "rear body"),
    )

    behind = phi + sign * gamma
    axles = {
        "front": (x, y, phi),
        "rear": (x - a * cos(phi) - c * cos(behind), y - a * sin(phi) - c * sin(behind), phi + gamma),
    }
    for name, (x_axle, y_axle, heading) in axles.items():
        robot.rolls(
            f"no side slip, {name}", cos(heading) * robot.rate(y_axle) - sin(heading) * robot.rate(x_axle)
        )
    # Centres of mass, here above the axles
    masses = {"front": (m_f, I_f, axles["front"]), "rear": (m_r, I_r, axles["rear"])}
    for m, inertia, (x_mass, y_mass, heading) in masses.values():
        robot.kinetic_energy(
            m * (robot.rate(x_mass) ** 2 + robot.rate(y_mass) ** 2) / 2
            + inertia * robot.rate(heading) ** 2 / 2
        )
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    robot.input("push", "N", on=forward)
    robot.input("steer", "N m", on=robot.rate(gamma))
    robot.quasi_velocity("v", "m/s", forward)
    robot.quasi_velocity("gammadot", "rad/s", robot.rate(gamma))
    robot.moves_in_plane(x, y, phi)
    return robot


robot = roller()
system = reduce(robot)
print("S =", system.S)

# %% [markdown]
# The third row of $S$ says how the joint turns the front body:
# $\dot\varphi = -\frac{v\sin\gamma + c\,\dot\gamma}{c + a\cos\gamma}$. To see it by hand, take the velocity
# of the rear axle *across* the rear body. Driving gives $v\sin\gamma$, turning the front body
# $a\dot\varphi\cos\gamma + c\dot\varphi$, turning the joint $c\dot\gamma$ (each with the same sign); the sum
# must be zero. So the front body turns even at standstill.
#
# ## Is it the robot you meant?
#
# A model can be wrong and still compile. Three questions that you can answer without noslip find most
# mistakes:
#
# - *A case that you know.* While the joint is held at an angle $\gamma$ the robot drives a circle. Both axles
#   point to its centre (the drawing above), and the right-angled triangles there give the front axle the
#   curvature $\sin\gamma / (c + a\cos\gamma)$ to the right.
# - *Constraints hold.* $A S = 0$: `reduce` has checked that.
# - *Energy.* The work of the inputs must be the change of kinetic energy: the constraint forces do none. We
#   check it when the robot drives, below.

# %%
at = Function("at", [robot.q, robot.p], [system.S])


def curvature(model, gamma):
    """Of the front axle's circle to the right, 1/m, by the third row of S: yaw rate per forward speed."""
    S = Function("S", [model.mechanism.q, model.mechanism.p], [model.S])
    return -float(S([0.0, 0.0, 0.0, gamma], model.mechanism.parameter_values({}))[2, 0])


wrong = reduce(roller(sign=-1))
print("gamma   triangles   model   with a mistake")
for gamma in (0.2, 0.4, 0.6):
    triangles = np.sin(gamma) / (C + A * np.cos(gamma))
    print(f"{gamma:5.1f} {triangles:11.4f} {curvature(system, gamma):7.4f} {curvature(wrong, gamma):12.4f}")

# %% [markdown]
# The mistaken model has the rear axle on the wrong side of the joint's angle. It reduces, it has a control
# law, its C agrees with it to the last digits. Only a case that you know shows that it is another robot.
#
# ## What can be controlled?

# %%
from noslip.analysis.text import as_text

written = as_text(analyse(robot, ["type_iv_line"]))
print(written[written.index("Outputs") : written.index("Words")])

# %% [markdown]
# $P_l$ is a point $L$ ahead of the front axle. The joint turns the front body, which moves $P_l$ to the side;
# pushing moves it forward. Where the front body is normal to the path this fails, as for the LABMATE. The
# factor of $\det\Phi$ that is new here is $c$ (positive for this roller): with the rear axle under the joint,
# turning the joint would not turn the front body. *Driving straight* says what no output shows. With the
# front body straight, $\dot\varphi = 0$, the formula above leaves $c\,\dot\gamma = -v\sin\gamma$: a small
# angle decays as $e^{-vt/c}$ going forward, and grows in reverse. (*Zero dynamics* is the case in which all
# outputs are zero, so that the robot stands.)
#
# ## It drives
#
# The C is compiled and called every 10 ms. The roller starts 1 m beside the line $y = 0$, with its joint
# turned.

# %%
law, tau = control_law(system, output_map(system, "type_iv_line")), SX.sym("tau", 2)
rate = Function(
    "rate", [vertcat(robot.q, system.nu), tau, robot.p], [vertcat(system.qdot, system.acceleration(tau))]
)
energy = Function("energy", [robot.q, system.nu, robot.p], [system.nu.T @ system.Mbar @ system.nu / 2])
L, PERIOD = 1.0, 0.01  # m, s


def drive(speed, seconds=12.0):
    """Times (s), states (x, y, phi, gamma, v, gammadot) and the relative error of the energy balance along
    the line y = 0."""
    numbers = robot.parameter_values({})
    # L, A, B, C; kp, kd, kv
    controller = make_controller("c", law, numbers, [L, 0.0, 1.0, 0.0], [1.0, 2.5, 2.0])
    states, work = [np.array([0.0, 1.0, 0.0, 0.2, speed, 0.0])], 0.0
    start = float(energy(states[0][:4], states[0][4:], numbers))
    for _ in range(round(seconds / PERIOD)):
        now = states[-1]
        status, torques = controller.step(now, np.array([0.0, 0.0, 0.0, speed, 0.0]))
        if status != "ok" or abs(now[3]) > 1.5:  # at 90 degrees the bodies would touch
            break
        slopes = [np.zeros(6)]
        for share in (0.0, 0.5, 0.5, 1.0):
            slopes.append(rate(now + share * PERIOD * slopes[-1], torques, numbers).full().ravel())
        _, one, two, three, four = slopes
        states.append(now + PERIOD / 6 * (one + 2 * two + 2 * three + four))
        middle = (now + states[-1]) / 2
        work += PERIOD * float(torques @ middle[4:])  # both inputs act on quasi-velocities
    change = float(energy(states[-1][:4], states[-1][4:], numbers)) - start
    return PERIOD * np.arange(len(states)), np.array(states), abs(change - work) / start


figure, (above, over) = plt.subplots(
    2, 1, figsize=(8, 5.5), num="The way of the roller, and the angle of its joint over time"
)
for speed, label in ((1.0, "forward"), (-1.0, "in reverse")):
    t, states, error = drive(speed)
    print(
        f"{label}: {t[-1]:.1f} s, joint at {states[-1, 3]:+.3f} rad in the end, energy balance to {error:.0e}"
    )
    above.plot(states[:, 0], states[:, 1], label=label)
    over.plot(t, states[:, 3], label=label)
above.plot(0, 1, "o", color="#333333", label="start")
above.axhline(0, color="#777777", linestyle="--")
above.set(
    xlabel="x (m)",
    ylabel="y (m)",
    title="front axle, from above; in reverse the run ends after 1.1 s",
    aspect="equal",
    ylim=(-0.5, 1.8),
)
over.set(xlabel="t (s)", ylabel="gamma (rad)", title="angle of the joint")
over.legend()
figure.tight_layout()

# %% [markdown]
# Forward it arrives and the joint is straight. In reverse the joint folds within about a second, as the
# analysis has said: these are the zero dynamics of lesson 4. The law uses the motor of the joint to steer
# $P_l$, and has no input left to keep the joint straight. The energy is balanced but for the error of summing
# the work in steps of 10 ms, which is larger where the joint folds fast: with steps of 5 ms both numbers are
# a quarter. Constraint forces that did work would not shrink with the step.
#
# ## Exercises
#
# 1. Why does the front body turn if the joint is turned at standstill? Which way compared with the joint, and
#    by how much for a small angle?
# 2. A rear body with its centre of mass a distance $e$ behind its axle: which line of the model changes?
# 3. Which point would you steer in reverse, and why?
#
# <details><summary>Answers</summary>
#
# **1.** Turning the rear body about the joint would move the rear axle to the side, which it cannot. So the
# joint itself must give way to the other side, and takes the front body with it, which turns about the middle
# of its axle ($v = 0$). From $S$: $\dot\varphi = -\frac{c}{c + a\cos\gamma}\dot\gamma$: opposite to the
# joint, near $\gamma = 0$ by the share $c/(a + c)$.

# %%
row = at([0.0, 0.0, 0.0, 0.0], robot.parameter_values({}))
print(f"{float(row[2, 1]):.4f} = {-C / (A + C):.4f}")

# %% [markdown]
# **2.** Only that of the masses: the rear body's place becomes `x_axle - e * cos(heading)`, and $y$ likewise.
# The constraint stays where the wheels are. To use one place for both is the most frequent mistake.
#
# **3.** A point behind the rear axle: in the direction of travel it is then ahead of the axle, and the front
# body trails behind. Describe the robot from the rear body, with its heading as the heading of
# `moves_in_plane`.
#
# </details>
#
# Next: [a robot of your own](../docs/your_robot.md), with pictures, contacts and SPECs; [the robots that
# noslip ships](../docs/api.md).
