"""Controllers to call from Python, all with the interface of `controller.Controller`: `make_controller` in
backends.py.

The generated C (compiled.py) on this host or on an emulated processor (pil.py, targets.py), and CasADi's
evaluation of the model (symbolic.py). Functions used with a law: path tracking, odometry, integral action, in
Python and as compiled C of runtime_c/.
"""

BACKENDS = ("casadi", "c", "cf")  # CasADi in double, generated C in double, generated C in float
SCALAR = {"c": "double", "cf": "float"}  # of the generated C on this host, by backend
# Generated C in float on an emulated processor: backend -> target
ON_TARGET = {"m4f": "cortex-m4f", "rv32": "rv32imafc"}
# What the drives of a robot take, and from which law
DRIVES = ("torque", "velocity", "velocity+torque", "kinematic")
