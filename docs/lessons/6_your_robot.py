# %% [markdown]
# # Lesson 6: your own robot
#
# How does one write down a robot that nobody has written down before, and notice the mistakes? This lesson, of 15 minutes, does
# it for an articulated roller: a front body and a rear body with one rigid axle each, and a joint between them that a motor
# turns. The file is `docs/lessons/6_your_robot.py`.
#
# ## Four questions
#
# 1. *What moves?* The middle of the front axle $(x, y)$, the heading $\varphi$ of the front body, and the angle $\gamma$ of the
#    joint. The rear body has the heading $\varphi + \gamma$. That is $n = 4$.
# 2. *What cannot move?* Neither axle slips to the side: $m = 2$ constraints, so that $n - m = 2$ velocities are free.
# 3. *What has energy?* Each body moves and turns. Write the place of its centre of mass; noslip differentiates it.
# 4. *What acts?* A force that pushes the front axle forward, and a torque in the joint. As many inputs as free velocities.
#
# Nothing else is needed. In particular nobody solves for the motion of the rear body: that follows.

# %%
import matplotlib.pyplot as plt
import numpy as np
from casadi import SX, Function, cos, sin, vertcat
from noslip import Mechanism, analyse, control_law, make_controller, output_map, reduce

A, C = 1.0, 0.8  # m: joint behind the front axle, rear axle behind the joint


def roller(sign=1):
    """The roller; with `sign` = -1 there is a mistake in it."""
    robot = Mechanism("roller", "two bodies with an axle each, steered by the joint between them")
    x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
    gamma = robot.coordinate("gamma", "rad", "rear body relative to the front body")
    a, c = robot.parameter("a", A, "m", "joint behind the front axle"), robot.parameter("c", C, "m", "rear axle behind the joint")
    m_f, m_r = robot.parameter("m_f", 1200.0, "kg", "front body"), robot.parameter("m_r", 900.0, "kg", "rear body")
    I_f, I_r = robot.parameter("I_f", 400.0, "kg m^2", "front body"), robot.parameter("I_r", 250.0, "kg m^2", "rear body")

    behind = phi + sign * gamma
    rear_x, rear_y = x - a * cos(phi) - c * cos(behind), y - a * sin(phi) - c * sin(behind)
    for m, inertia, heading, place in ((m_f, I_f, phi, (x, y)), (m_r, I_r, phi + gamma, (rear_x, rear_y))):
        v_x, v_y = robot.rate(place[0]), robot.rate(place[1])
        robot.kinetic_energy(m * (v_x**2 + v_y**2) / 2 + inertia * robot.rate(heading) ** 2 / 2)
        robot.rolls(f"no side slip, {'front' if heading is phi else 'rear'}", cos(heading) * v_y - sin(heading) * v_x)
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
# $\dot\varphi = -\frac{v\sin\gamma + c\,\dot\gamma}{c + a\cos\gamma}$. It turns even at standstill, because the rear axle can
# only roll.
#
# ## Is it the robot you meant?
#
# A model can be wrong and still compile. Three questions that you can answer without noslip find most mistakes:
#
# - *A case that you know.* With a fixed joint the robot drives a circle. Both axles point to its centre, and from the two
#   triangles the front axle has the curvature $\sin\gamma / (c + a\cos\gamma)$.
# - *Constraints hold.* $A S = 0$: `reduce` has checked that.
# - *Energy.* The work of the inputs must be the change of kinetic energy: the constraint forces do none.

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
# The mistaken model has the rear axle on the wrong side of the joint's angle. It reduces, it has a control law, its C agrees
# with it to the last digits. Only a case that you know shows that it is another robot.
#
# ## What can be controlled?

# %%
from noslip.analysis.text import as_text

written = as_text(analyse(robot, ["type_iv_line"]))
print(written[written.index("Outputs") : written.index("  where  ")])

# %% [markdown]
# $P_l$ is a point $L$ ahead of the front axle. The joint turns the front body, which moves $P_l$ to the side; pushing moves it
# forward. Where the front body is normal to the path this fails, as for the LABMATE. The factor that is new here is $c$: with
# the rear axle under the joint, turning the joint at standstill would not turn the front body. *Driving straight* says what no
# output shows: the joint straightens as $e^{-vt/c}$ going forward, and folds in reverse.
#
# ## It drives
#
# The C is compiled and called every 10 ms. The roller starts 1 m beside the line $y = 0$, with its joint turned.

# %%
law, tau = control_law(system, output_map(system, "type_iv_line")), SX.sym("tau", 2)
rate = Function("rate", [vertcat(robot.q, system.nu), tau, robot.p], [vertcat(system.qdot, system.acceleration(tau))])
energy = Function("energy", [robot.q, system.nu, robot.p], [system.nu.T @ system.Mbar @ system.nu / 2])
L, PERIOD = 1.0, 0.01  # m, s


def drive(speed, seconds=12.0):
    """Times (s), states (x, y, phi, gamma, v, gammadot) and the relative error of the energy balance along the line y = 0."""
    numbers = robot.parameter_values({})
    controller = make_controller("c", law, numbers, [L, 0.0, 1.0, 0.0], [1.0, 2.5, 2.0])  # L, A, B, C; kp, kd, kv
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


figure, (above, over) = plt.subplots(1, 2, figsize=(10, 3.4), num="The way of the roller, and the angle of its joint over time")
for speed, label in ((1.0, "forward"), (-1.0, "in reverse")):
    t, states, error = drive(speed)
    print(f"{label}: {t[-1]:.1f} s, joint at {states[-1, 3]:+.3f} rad in the end, energy balance to {error:.0e}")
    above.plot(states[:, 0], states[:, 1], label=label)
    over.plot(t, states[:, 3], label=label)
above.axhline(0, color="#777777", linestyle="--")
above.set(xlabel="x (m)", ylabel="y (m)", title="front axle, from above")
above.set_aspect("equal", adjustable="datalim")
over.set(xlabel="t (s)", ylabel="gamma (rad)")
over.legend()

# %% [markdown]
# Forward it arrives and the joint is straight. In reverse the joint folds within about a second, as the analysis has said: these
# are the zero dynamics of lesson 4. The law uses the motor of the joint to steer $P_l$, and has none left to keep it straight.
#
# ## Exercises
#
# 1. Why does the front body turn if the joint is turned at standstill? Which way, and by how much for a small angle?
# 2. A rear body with its centre of mass a distance $e$ behind its axle: which line of the model changes?
# 3. Which point would you steer in reverse, and why?
#
# <details><summary>Answers</summary>
#
# **1.** The rear axle cannot move to the side, so that the rear body can turn only about a point of its axle's line. With $v =
# 0$ the front axle's middle stays too. From $S$: $\dot\varphi = -\frac{c}{c + a\cos\gamma}\dot\gamma$: opposite to the joint,
# near $\gamma = 0$ by the share $c/(a + c)$.

# %%
row = at([0.0, 0.0, 0.0, 0.0], robot.parameter_values({}))
print(f"{float(row[2, 1]):.4f} = {-C / (A + C):.4f}")

# %% [markdown]
# **2.** Only the place whose velocity is in the kinetic energy: `rear_x - e cos(phi + gamma)`, and $y$ likewise. The constraint
# stays where the wheels are. To use one place for both is the most frequent mistake.
#
# **3.** A point behind the rear axle: in the direction of travel it is then ahead of the axle, and the front body trails behind.
# Describe the robot from the rear body, with its heading as the heading of `moves_in_plane`.
#
# </details>
#
# Next: [a robot of your own](../docs/your_robot.md), with pictures, contacts and SPECs; [the robots that noslip
# ships](../docs/api.md).
