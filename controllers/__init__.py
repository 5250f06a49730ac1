"""Controllers to call from Python, all with the interface of `controller.Controller`: `make_controller` in backends.py.

The generated C (compiled.py) on this host or on an emulated processor (pil.py, targets.py), and CasADi's evaluation of the
model (symbolic.py). Functions used with a law: path tracking, odometry, integral action, in Python and as compiled C of
runtime_c/.
"""
