"""The parameters of a robot from a log of its motion and its inputs: what can be identified, the fit,
and its uncertainty."""
