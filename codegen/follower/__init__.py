"""One struct from the counters of the encoders to the commands of the drives, for a vehicle with two driven
wheels or a steered one.
"""
