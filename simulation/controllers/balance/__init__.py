"""State feedback about a steady motion of a robot with fewer inputs than degrees of freedom: gains,
feedback, the same in C."""
