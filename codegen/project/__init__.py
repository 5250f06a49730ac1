"""The texts of an exported project: build files, control loop, self-test."""
