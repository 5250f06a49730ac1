"""A project's C as a package, in the form that each package manager requires."""
