"""The extended Kalman filter of a robot: its steps, and their C."""
