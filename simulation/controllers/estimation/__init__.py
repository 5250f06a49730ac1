"""The generated extended Kalman filter of a robot, called from Python."""
