"""A law, a plant or their loop as a functional mock-up unit (FMU) by the standard FMI 3.0:
its description and its C."""
