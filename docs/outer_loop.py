# %% [markdown]
# # The outer loop of the LABMATE, with python-control
#
# After exact linearization each output is a chain of integrators, and its gains are designed in one line. The
# remaining question is how they perform on a processor that calls the law every few milliseconds, with
# parameters that are never exact. Run this file as a script, or its cells in a notebook in docs/ (in the root
# of the repository `import control` would find the folder of that name). Nothing is plotted; each cell ends
# with an assertion of its result.

# %%
from dataclasses import replace
from pathlib import Path

import control
import noslip
import numpy as np
from noslip import read_spec
from noslip.analysis.outer import (
    Channel,
    Loops,
    Weights,
    closed_loop_system,
    from_hinf,
    from_lqr,
    from_mixed,
    from_poles,
    from_settling,
    longest_period,
    ranking,
    setting_of,
    steady_motion,
    with_errors,
)
from noslip.simulation.loop import make_loop

SPECS = Path(noslip.__file__).parent / "examples/specs"

# %% [markdown]
# ## Gains of a channel
# The distance from the path has relative degree 2. Overdamped, it does not overshoot beside a wall.

# %%
gains = from_settling(2, settling=4.0, damping=1.25)
print(gains.named("distance"), "poles", gains.poles)

distance = Channel("distance", "m", gains)
response = control.step_response(distance.closed(), np.linspace(0, 8, 801), squeeze=False)
y = response.outputs[0, 0]
assert y.max() <= 1.0 and abs(y[400] - 0.98) < 1e-6

# %% [markdown]
# The same by LQR, from the largest acceptable error, rate and v (Bryson's rule). All objects are
# python-control's.

# %%
print(from_lqr(2, largest=[0.1, 0.2, 0.5]).named("distance"))
print(distance.plant())
assert control.poles(distance.closed()).real.max() < 0

# %% [markdown]
# ## Disturbances
# A slope, a draught or a wrong mass acts as a disturbance d of v. An H-infinity design takes the largest one
# besides the largest values of LQR, here 0.4 m/s^2: an oscillation of that size, of any frequency, leaves the
# error below 0.1 m, its rate below 0.2 m/s and v below 0.5 m/s^2. LQR by the same values does not promise
# that. The command has it as `noslip outer-loop --hinf distance=0.1,0.2,0.5,0.4`.

# %%
largest = [0.1, 0.2, 0.5, 0.4]
for name, each in (("LQR", from_lqr(2, largest[:3])), ("H-infinity", from_hinf(2, largest))):
    print(f"{name}: {each.named('distance')}, norm {Channel('distance', 'm', each).norm(largest):.3f}")
assert Channel("distance", "m", from_hinf(2, largest)).norm(largest) < 1

# %% [markdown]
# Mixed sensitivity: S small up to 1 rad/s, T from 20 rad/s on, neither above 2. A controller by Riccati
# equations (slycot) would have the order of chain and weights; these are static gains, those of the law,
# found by a search, with no pole slower than 0.3 times the band of S. The norm is a bisection's. The same is
# `noslip outer-loop --mixed distance=1,20,2`. It is a design in continuous time: margins of the sampled loop
# are judged after it.

# %%
gains_mixed, reached = from_mixed(2, Weights(band=1.0, roll_off=20.0, peak=2.0))
print(f"mixed sensitivity: kp {gains_mixed.error:.3g}, kd {gains_mixed.rate:.3g}, norm {reached:.3g}")
assert reached < 1
assert Channel("distance", "m", from_lqr(2, largest[:3])).norm(largest) > 1

# %% [markdown]
# A disturbance that lasts is removed by integral action, or by an observer that estimates it
# (`noslip_disturbance.h`, the gain `ko` in a SPEC, `noslip outer-loop --observer 4`). Both give the loop one
# pole more. With an observer those of the gains stay, and a step of the reference is answered as without one;
# integral action by the same poles overshoots.

# %%
by_observer = replace(from_poles(2, [-1.0, -1.0]), observer=4.0)
by_integral = from_poles(2, [-1.0, -1.0, -4.0], integral=True)
for each in (by_observer, by_integral):
    channel = Channel("distance", "m", each)
    response = control.step_response(channel.closed(), np.linspace(0, 10, 1001), squeeze=False)
    print(
        f"{each.named('distance')}: overshoot {100 * (response.outputs[0, 0].max() - 1):.1f} %, poles "
        f"{channel.poles.real}"
    )
    assert (response.outputs[0, 0].max() < 1.001) == (each is by_observer)

# %% [markdown]
# ## On a processor
# The law is called every 20 ms and the torque is delayed by one sample: margins, and the longest stable
# period.

# %%
sampled = Channel("distance", "m", gains, period=0.02, delay=True)
print(f"phase margin {np.degrees(sampled.margins().phase):.1f} deg, Ms {sampled.margins().Ms:.3f}")
print(f"stable up to {longest_period(gains, delay=True):.4f} s")
assert sampled.margins().Ms < 1.3

# %% [markdown]
# ## The whole loop
# A channel does not include the robot. About the motion around the circle at 5 m/s the loop has four
# eigenvalues: the three of the channels and -v/l of the heading, which makes the longest stable period much
# shorter.

# %%
spec = read_spec(SPECS / "circle.toml")
motion = steady_motion(setting_of(spec))
print(motion.names, motion.eigenvalues())
print(f"the whole loop is stable up to {motion.longest_period():.4f} s")
assert np.allclose(motion.eigenvalues(), [-1, -2, -4, -5 / 0.3], atol=1e-8)
assert motion.longest_period() < longest_period(from_settling(2, 4.0))

# %% [markdown]
# ## A wrong model
# The true robot is twice as heavy as the law assumes (the paper's figure 9b): it follows a circle 8.7 cm too
# large. Of single errors of 20 %, that of the sensed heading (0.2 rad) has the largest effect: the offset
# that it leaves.

# %%
heavy = with_errors(motion, {"m_c": 1.0, "m_w": 1.0})
print(f"{100 * heavy.offset:.2f} cm outside; eigenvalues {heavy.eigenvalues}")
assert abs(heavy.offset - 0.087) < 0.0005
worst = ranking(motion, 0.2, Loops(period=0.01))
for harm in worst[:3]:
    print(
        f"{harm.name}: decay {harm.decay:.3f} 1/s, disk margin {harm.disk:.3f}, longest period "
        f"{harm.longest_period:.4f} s"
    )
assert worst[0].name == "heading"

# %% [markdown]
# ## The generated C inside python-control
# Robot and controller are systems with named signals, connected by `control.interconnect`. Integral action in
# the distance removes the offset.

# %%
truth = replace(spec, plant={"m_c": 60.0, "m_w": 2.0}, gains={**spec.gains, "ki_distance": 2.0})
loop = make_loop(truth)
system = closed_loop_system(loop)
print(system.input_labels, system.output_labels)
start = np.append(loop.start, 0.0)  # the integral begins at 0
times = np.linspace(0, 45, 181)
reference = [float(value) for value in loop.guidance.reference(0.0, loop.start)]
run = control.input_output_response(
    system, times, reference, start, solve_ivp_kwargs={"method": "DOP853", "rtol": 1e-9, "atol": 1e-9}
)
error = np.hypot(run.outputs[0] - 20, run.outputs[1] - 20) - 10
print(f"off by {error[-1]:.1e} m after {times[-1]:g} s")
assert abs(error[-1]) < 1e-6
