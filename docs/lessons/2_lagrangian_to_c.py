# %% [markdown]
# # Lesson 2: from Lagrangian to C, on one page
#
# A robot is described by its energies and by the velocities that are zero where it rolls. From this noslip derives a control
# law and writes it as C. This lesson goes through all the steps with the smallest robot there is. It takes about 15 minutes;
# you need Lagrange's equations and linear feedback. The file is `docs/lessons/2_lagrangian_to_c.py`. Numbers such as (15) are
# equations of the paper, see [the method](../docs/method.md).
#
# ## 1. The robot
#
# A cart with a blade: pushed forward with a force, turned with a torque. Its coordinates are $q = (x, y, \varphi)$, its
# Lagrangian is the kinetic energy $\frac{m}{2}(\dot x^2 + \dot y^2) + \frac{I}{2}\dot\varphi^2$, and the blade does not slip to
# the side (lesson 1).

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
# Lagrange's equations contain the unknown force of the blade, $\lambda$: $M\ddot q + V = E\tau - A^T\lambda$ (8). All permitted
# velocities are $\dot q = S(q)\nu$ (9), where the columns of $S$ span the null space of $A$: $A S = 0$. Multiply (8) by $S^T$
# and $\lambda$ is gone:
#
# $$S^T M S\,\dot\nu + S^T(M\dot S\nu + V) = S^T E\,\tau$$

# %%
system = reduce(robot)
print("S =", system.S)
print("S'MS =", system.Mbar)
print("bias =", system.bias)

# %% [markdown]
# Two equations for two unknown accelerations: $m\dot v$ is the push, $I\dot\omega$ the torque. For a robot with more bodies the
# same lines give pages of terms; the steps stay the same.
#
# ## 3. Linearize: what the inputs do to the outputs
#
# The cart shall follow a line at a given speed. The outputs are the distance of a point $P_l$, a length $L$ ahead, from the
# line $Ax + By + C = 0$, and the forward speed. Their derivatives depend on the inputs through the decoupling matrix $\Phi$
# (15). The distance must be differentiated twice until the inputs appear, the speed once: these are the relative degrees.

# %%
outputs = output_map(system, "type_iv_line")
linearization = linearize(system, outputs)
print("relative degrees:", linearization.relative_degree)
print("Phi =", linearization.Phi)
print("det Phi =", linearization.determinant)

# %% [markdown]
# ## 4. The law
#
# Where $\Phi$ is invertible, the feedback $u = \Phi^{-1}(w - \dot\Phi\nu)$ (20) makes the distance obey $\ddot y = w$. A linear
# outer loop chooses $w = -k_d\dot y - k_p y$, and the distance decays like a damped spring.

# %%
law = control_law(system, outputs)
files = generate(system, [law], scalars=["float"], dynamics=False)
code = files["cart_type_iv_line_f.c"]
start = code.index("static int cart_type_iv_line_step_f_law")
print(code[start : code.index("\n}\n", start) + 2])

# %% [markdown]
# This is the law: one sine and cosine, a test for the singular set, and a handful of multiplications. What does not depend on
# the state ($k_1, k_2, \ldots$) is computed once, by `init`. Before `generate` returned the text, it compared the C with the
# model.
#
# ## 5. It drives
#
# `make_controller("c", ...)` compiles the C for this computer and calls it every 10 ms. In between the torques are held, and
# the reduced equations are integrated by the method of Runge and Kutta. The line is the x-axis, the cart starts 1 m beside it
# and parallel to it, at 1 m/s.

# %%
tau = SX.sym("tau", 2)
rate = Function("rate", [vertcat(robot.q, system.nu), tau, robot.p], [vertcat(system.qdot, system.acceleration(tau))])
L, PERIOD = 0.5, 0.01  # m, s


def drive(gains, seconds=8.0, mass=12.0, speed=1.5):
    """Times (s) and states (x, y, phi, v, omega) of the closed loop; `mass` is that of the cart, the law believes 12 kg."""
    believed, true = robot.parameter_values({}), robot.parameter_values({"m": mass})
    controller = make_controller("c", law, believed, [L, 0.0, 1.0, 0.0], gains)  # L, A, B, C: the line y = 0
    states = [np.array([0.0, 1.0, 0.0, 1.0, 0.0])]
    for _ in range(round(seconds / PERIOD)):
        now = states[-1]
        status, torques = controller.step(now, np.array([0.0, 0.0, 0.0, speed, 0.0]))
        assert status == "ok", status
        slopes = [np.zeros(5)]
        for share in (0.0, 0.5, 0.5, 1.0):
            slopes.append(rate(now + share * PERIOD * slopes[-1], torques, true).full().ravel())
        _, one, two, three, four = slopes
        states.append(now + PERIOD / 6 * (one + 2 * two + 2 * three + four))
    return PERIOD * np.arange(len(states)), np.array(states)


def distance(states):
    """Of P_l from the line, m."""
    return states[:, 1] + L * np.sin(states[:, 2])


t, states = drive(gains=[1.0, 2.5, 2.0])  # kp and kd of the distance, kv of the speed
figure, (above, over) = plt.subplots(1, 2, figsize=(10, 3.4), num="The way of the cart, and distance and speed over time")
above.plot(states[:, 0], states[:, 1])
above.axhline(0, color="#777777", linestyle="--")
above.set(xlabel="x (m)", ylabel="y (m)", title="from above")
over.plot(t, distance(states), label="distance of P_l (m)")
over.plot(t, states[:, 3], label="speed (m/s)")
over.set(xlabel="t (s)")
over.legend()

# %% [markdown]
# The robot is nonlinear, and yet the distance is the solution of the linear equation $\ddot y + 2.5\,\dot y + y = 0$: that is
# what the linearizing feedback is for.
#
# ## Exercises
#
# 1. For which headings is $\Phi$ singular? What does that mean for the cart, and what happens for $L = 0$?
# 2. The true cart weighs 24 kg, the law believes 12 kg. Is there a speed error in the end?
# 3. Choose $k_p$ and $k_d$ such that the distance has both poles at $-2$ 1/s. Compare with the solution of the linear equation.
#
# <details><summary>Answers</summary>
#
# **1.** $\det\Phi = L\,(A\sin\varphi - B\cos\varphi)/\sqrt{A^2 + B^2}$ vanishes where the heading is normal to the line:
# turning then moves $P_l$ along the line, and pushing is needed for both outputs. For $L = 0$ it vanishes everywhere: turning
# does not move $P_l$ at all, and the distance would need to be differentiated once more. The C returns the status
# `NOSLIP_SINGULAR`.
#
# **2.** No: at the desired speed no push is needed, whatever the mass. It takes longer to get there.

# %%
for mass in (12.0, 24.0):
    t, states = drive([1.0, 2.5, 2.0], mass=mass)
    reached, error = t[np.argmax(states[:, 3] > 1.0 + 0.63 * 0.5)], 1.5 - states[-1, 3]
    print(f"{mass:g} kg: {reached:.2f} s to 63 % of the step in speed, error in the end {error:.1e} m/s")

# %% [markdown]
# **3.** $(s + 2)^2 = s^2 + 4 s + 4$, so $k_d = 4$ and $k_p = 4$. From 1 m and parallel to the line the solution is $y = (1 +
# 2t)\,e^{-2t}$.

# %%
t, states = drive([4.0, 4.0, 2.0])
exact = (1 + 2 * t) * np.exp(-2 * t)
print(f"largest difference {np.abs(distance(states) - exact).max():.3f} m, from holding the torques for 10 ms")

# %% [markdown]
# </details>
#
# Next: [a robot of your own](../docs/your_robot.md), with energy, constraints and C checked step by step.
