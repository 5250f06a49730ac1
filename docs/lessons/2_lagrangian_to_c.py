# %% [markdown]
# # Lesson 2: from Lagrangian to C, on one page
#
# A robot is described by its energies and by the velocities that are zero where it rolls. From this noslip
# derives a control law and writes it as C. This lesson goes through all the steps with the smallest robot
# there is. It takes about 25 minutes; you need Lagrange's equations and linear feedback; [how to run a
# lesson](README.md). Numbers such as (15) are equations of the paper, see [the method](../docs/method.md).
#
# ## 1. The robot
#
# A cart with a blade: pushed forward with a force, turned with a torque. Its coordinates are $q = (x, y,
# \varphi)$, its Lagrangian is the kinetic energy $\frac{m}{2}(\dot x^2 + \dot y^2) +
# \frac{I}{2}\dot\varphi^2$, and the blade does not slip to the side (lesson 1).

# %%
import matplotlib.pyplot as plt
import numpy as np
from casadi import SX, Function, cos, sin, vertcat
from noslip import Mechanism, control_law, generate, linearize, make_controller, output_map, reduce

robot = Mechanism("cart", "pushed forward and turned")
x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
m = robot.parameter("m", 12.0, "kg", "mass")
inertia = robot.parameter("I", 0.8, "kg m^2", "about the vertical")

forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
turning = robot.rate(phi)
robot.kinetic_energy(m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + inertia * turning**2 / 2)
robot.rolls("no side slip", cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x))
robot.input("push", "N", on=forward)
robot.input("turn", "N m", on=turning)
robot.quasi_velocity("v", "m/s", forward)
robot.quasi_velocity("omega", "rad/s", turning)
robot.moves_in_plane(x, y, phi)

# %% [markdown]
# ## 2. Reduce: the constraint force drops out
#
# Lagrange's equations contain the unknown force of the blade, $\lambda$:
#
# $$M\ddot q + V = E\tau - A^T\lambda \qquad (8)$$
#
# $M$ is the mass matrix, here diagonal with $m, m, I$. $V(q, \dot q)$ has the terms without accelerations,
# here none. $\tau$ are the inputs, push and torque, and $E$ says on which coordinates they act. The
# constraint is $A\dot q = 0$ with $A = (-\sin\varphi, \cos\varphi, 0)$, and its force acts along $A^T$.
#
# All velocities with $A\dot q = 0$ are $\dot q = S(q)\nu$ (9), where the columns of $S$ span the null space
# of $A$, thus $A S = 0$. The numbers $\nu$ are the quasi-velocities, here $\nu = (v, \omega)$. Differentiate,
# $\ddot q = S\dot\nu + \dot S\nu$, and multiply (8) by $S^T$. Since $S^T A^T = (A S)^T = 0$, the force is
# gone:
#
# $$S^T M S\,\dot\nu + S^T(M\dot S\nu + V) = S^T E\,\tau \qquad (10)$$

# %%
system = reduce(robot)
print("S =", system.S)
print("S'MS =", system.Mbar)
print("bias, S'(M Sdot nu + V) =", system.bias)

# %% [markdown]
# (`00` is an entry that is zero by structure.) Two equations for two unknown accelerations: $m\dot v$ is the
# push, $I\dot\omega$ the torque. For a robot with more bodies the same lines give pages of terms; the steps
# stay the same.
#
# ## 3. Linearize: what the inputs do to the outputs
#
# The cart shall follow a line at a given speed. Take the x-axis as the line. The outputs are the distance of
# a point $P_l$, a length $L$ ahead of $(x, y)$, from the line, $h_1 = y + L\sin\varphi$, and the forward
# speed $h_2 = v$. Differentiate until the accelerations $u = \dot\nu = (\dot v, \dot\omega)$ appear, twice
# for the distance and once for the speed (these numbers are the *relative degrees*):
#
# $$\dot h_1 = v\sin\varphi + \omega L\cos\varphi, \qquad
#   \ddot h_1 = \dot v\sin\varphi + \dot\omega L\cos\varphi + \text{terms without accelerations}, \qquad \dot
#   h_2 = \dot v$$
#
# In general the outputs obey $\ddot h = \Phi u + \dot\Phi\nu$ ($\dot h$ for the speed), and the matrix in
# front of $u$,
#
# $$\Phi = \begin{pmatrix} \sin\varphi & L\cos\varphi \\ 1 & 0 \end{pmatrix} \qquad (15)$$
#
# is the *decoupling matrix*. noslip finds the same for every line $Ax + By + C = 0$ (`config.A` ... are
# settings of the law, `sq` is a square):

# %%
outputs = output_map(system, "type_iv_line")
linearization = linearize(system, outputs)
print("relative degrees:", linearization.relative_degree)
print("Phi =", linearization.Phi)
print("det Phi =", linearization.determinant)

# %% [markdown]
# ## 4. The law
#
# Where $\Phi$ is invertible, choose
#
# $$u = \Phi^{-1}(w - \dot\Phi\nu) \qquad (20)$$
#
# and the distance obeys $\ddot h_1 = w_1$, the speed $\dot h_2 = w_2$. A linear outer loop chooses the
# *virtual inputs* $w_1 =
# -k_d\dot h_1 - k_p h_1$ and $w_2 = -k_v(h_2 - v_d)$: the distance decays like a damped spring, the speed
# error like $e^{-k_v t}$. (The paper and the C call them $v$, which here is the speed.) The
# reduced equations (10) then say which inputs $\tau$ give the accelerations $u$; here $\tau = (m u_1, I
# u_2)$.

# %%
law = control_law(system, outputs)
files = generate(system, [law], scalars=["float"], dynamics=False)
code = files["cart_type_iv_line_f.c"]
start = code.index("static int cart_type_iv_line_step_f_law")
print(code[start : code.index("\n}\n", start) + 2])

# %% [markdown]
# This is the law. Find in it: one sine and cosine; the second and the first entry of $\Phi$'s row for the
# distance (`distance_by_yaw_rate`, `distance_by_forward_speed`); the test for the singular set, where the
# first is too small to divide by; the virtual inputs (`v_distance`; that of the speed is shared between two
# terms, so that $\omega^2 L$ goes out and comes in again); the division, which is $\Phi^{-1}$. What does not
# depend on the state ($k_1, k_2, \ldots$) is computed once, by `init`. Before `generate` returned the text,
# it compared the C with the model.
#
# ## 5. It drives
#
# `make_controller("c", ...)` compiles the C for this computer. We call it every 10 ms; in between the inputs
# are held, and the reduced equations are integrated, by the method of Runge and Kutta. The line is the
# x-axis, the cart starts 1 m beside it and parallel to it, at 1 m/s, and shall drive at 1.5 m/s.

# %%
tau = SX.sym("tau", 2)
rate = Function(
    "rate", [vertcat(robot.q, system.nu), tau, robot.p], [vertcat(system.qdot, system.acceleration(tau))]
)
L, PERIOD = 0.5, 0.01  # m, s


def drive(gains, seconds=8.0, mass=12.0, speed=1.5):
    """Times (s) and states (x, y, phi, v, omega) of the closed loop; `mass` is that of the cart,
    the law believes 12 kg."""
    believed, true = robot.parameter_values({}), robot.parameter_values({"m": mass})
    controller = make_controller("c", law, believed, [L, 0.0, 1.0, 0.0], gains)  # L, A, B, C: the line y = 0
    states = [np.array([0.0, 1.0, 0.0, 1.0, 0.0])]
    for _ in range(round(seconds / PERIOD)):
        now = states[-1]
        desired = [0.0, 0.0, 0.0, speed, 0.0]  # distance, its rate and acceleration; speed and its rate
        status, inputs = controller.step(now, np.array(desired))
        assert status == "ok", status
        states.append(runge_kutta(lambda state, inputs=inputs: rate(state, inputs, true).full().ravel(), now))
    return PERIOD * np.arange(len(states)), np.array(states)


def runge_kutta(slope, state):
    """The state one period later, for a slope as a function of the state."""
    one = slope(state)
    two = slope(state + PERIOD / 2 * one)
    three = slope(state + PERIOD / 2 * two)
    four = slope(state + PERIOD * three)
    return state + PERIOD / 6 * (one + 2 * two + 2 * three + four)


def distance(states):
    """Of P_l from the line, m."""
    return states[:, 1] + L * np.sin(states[:, 2])


t, states = drive(gains=[1.0, 2.5, 2.0])  # kp and kd of the distance, kv of the speed
figure, (above, over) = plt.subplots(
    2, 1, figsize=(8, 5.5), num="The way of the cart, and distance and speed over time"
)
above.plot(states[:, 0], states[:, 1])
above.axhline(0, color="#777777", linestyle="--")
above.set(xlabel="x (m)", ylabel="y (m)", title="from above", aspect="equal")
over.plot(t, distance(states), label="distance of P_l (m)")
exact = (4 * np.exp(-0.5 * t) - np.exp(-2 * t)) / 3  # of h'' + 2.5 h' + h = 0 from h = 1, h' = 0
over.plot(
    t[::40], exact[::40], "o", markersize=4, color="#777777", label="solution of the linear equation (m)"
)
over.plot(t, states[:, 3], label="speed (m/s)")
over.set(xlabel="t (s)")
over.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
figure.tight_layout()

# %% [markdown]
# The robot is nonlinear, and yet the distance is the solution of the linear equation $\ddot h_1 + 2.5\,\dot
# h_1 + h_1 = 0$: that is what the linearizing feedback is for.
#
# ## Exercises
#
# 1. For which headings is $\Phi$ singular? What does that mean for the cart, and what happens for $L = 0$?
# 2. The true cart weighs 24 kg, the law believes 12 kg. Is there a speed error in the end? Does it take
#    longer to get there?
# 3. Choose $k_p$ and $k_d$ such that the distance has both poles (the roots of $s^2 + k_d s + k_p$) at $-2$
#    1/s. Compare with the solution of the linear equation.
#
# <details><summary>Answers</summary>
#
# **1.** $\det\Phi = L\,(A\sin\varphi - B\cos\varphi)/\sqrt{A^2 + B^2}$ vanishes where the heading is normal
# to the line: turning then moves $P_l$ along the line, and pushing is needed for both outputs. For $L = 0$ it
# vanishes everywhere: turning does not move $P_l$ at all, and the distance would need to be differentiated
# once more. The C returns the status `NOSLIP_SINGULAR`.
#
# **2.** No: at the desired speed no push is needed, whatever the mass. It takes twice as long: with half the
# push that it needs, $\dot v = -\frac{k_v}{2}(v - v_d)$. After $1/k_v$, one time constant, an exponential has
# gone 63 % of its way.

# %%
for mass in (12.0, 24.0):
    t, states = drive([1.0, 2.5, 2.0], mass=mass)
    reached, error = t[np.argmax(states[:, 3] > 1.0 + 0.63 * 0.5)], 1.5 - states[-1, 3]
    print(f"{mass:g} kg: {reached:.2f} s to 63 % of the step in speed, error in the end {error:.1e} m/s")

# %% [markdown]
# **3.** $(s + 2)^2 = s^2 + 4 s + 4$, so $k_d = 4$ and $k_p = 4$. From 1 m and parallel to the line the
# solution is $h_1 = (1 + 2t)\,e^{-2t}$.

# %%
t, states = drive([4.0, 4.0, 2.0])
exact = (1 + 2 * t) * np.exp(-2 * t)
print(
    f"largest difference {np.abs(distance(states) - exact).max():.3f} m, from holding the torques for 10 ms"
)

# %% [markdown]
# </details>
#
# Next: [lesson 3](3_cusps.py), why trajectory tracking has cusps and path following none.
