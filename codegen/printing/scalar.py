"""The two scalars of the C: public names for float are those for double with the suffix _f."""

from dataclasses import dataclass

import numpy as np

from ...model.errors import ModelError


@dataclass(frozen=True)
class Scalar:
    """A C floating-point type and the suffix of names that use it."""

    real: str
    suffix: str

    def name(self, name: str) -> str:
        """Return the C name of something that exists for both scalars."""
        return name + self.suffix

    def literal(self, value: float) -> str:
        """Return the shortest decimal that is read as `value` in this type. Raises ModelError if it does not
        fit."""
        if not np.isfinite(value):
            raise ModelError(f"the constant {value!r} is not finite")
        if self.real == "double":
            text = repr(float(value))
        else:
            with np.errstate(over="ignore", under="ignore"):
                narrow = np.float32(value)
            lost = abs(narrow) < np.finfo(np.float32).tiny and float(narrow) != value
            if not np.isfinite(narrow) or lost:
                raise ModelError(
                    f"the constant {value!r} does not fit into a float; give the robot's numbers in units in "
                    "which they are of like size, or generate double alone"
                )
            text = str(narrow)
        return text + ("f" if self.real == "float" else "")


DOUBLE = Scalar("double", "")
FLOAT = Scalar("float", "_f")
SCALARS = {"double": DOUBLE, "float": FLOAT}
