"""A controller whose numbers come from the generated C, in double or float."""

from collections.abc import Sequence
from functools import cache, cached_property, lru_cache

import cffi
import numpy as np

from ..codegen.files import law_program, law_text, shared_files
from ..codegen.law_c import LawC, foot_declaration
from ..codegen.robot_c import robot_declarations
from ..codegen.scalar import SCALARS
from ..model.law import ControlLaw
from .backends import ON_LIMIT, QUANTITIES, Evaluation, Limits
from .runtime import load


class Library:
    """The compiled C of one law in one scalar: `ffi` knows its types, `lib` its functions, `files` are its text."""

    def __init__(self, law: ControlLaw, scalar: str):
        self.text: LawC = law_text(law_program(law), SCALARS[scalar])
        self.ffi = cffi.FFI()
        self.ffi.cdef("const char *noslip_status_name(int status);")
        self.ffi.cdef(foot_declaration(SCALARS[scalar]))
        self.ffi.cdef(robot_declarations(law.system, SCALARS[scalar]))
        self.ffi.cdef(self.text.declarations())
        self.files = {**shared_files(law.system, SCALARS[scalar]), **self.text.files()}
        self.lib = load(self.ffi, self.files)

    def name(self, name: str) -> str:
        """The C name of something of this law."""
        return self.text.scalar.name(f"{self.text.prefix}_{name}" if name else self.text.prefix)

    def robot_name(self, name: str) -> str:
        """The C name of something that the robot's laws share."""
        return self.text.scalar.name(f"{self.text.robot}_{name}")

    def instance(self):
        """A law that init has not seen yet."""
        return self.ffi.new(f"{self.name('')} *")

    def function(self, name: str):
        """An entry point of the law."""
        return getattr(self.lib, self.name(name))

    def status(self, number: int) -> str:
        """Name of a status."""
        return self.ffi.string(self.lib.noslip_status_name(number)).decode()


@lru_cache(maxsize=64)
def library(law: ControlLaw, scalar: str) -> Library:
    """The law's compiled C, loaded once per process."""
    return Library(law, scalar)


class CompiledController:
    """One instance of a generated law: its struct, made by init from parameters, configuration, gains and limits.

    A parameter that init refuses is kept as `refused`, and every call answers that status, as in firmware.
    """

    def __init__(
        self,
        law: ControlLaw,
        params: Sequence[float],
        config: Sequence[float],
        gains: Sequence[float],
        scalar: str = "double",
        limits: Limits | None = None,
        made_by: Library | None = None,
    ):
        """`made_by`: the law's library, where it is not that of this host and scalar."""
        self.law = law
        self._library = made_by or library(law, scalar)
        ffi, name = self._library.ffi, self._library.name
        self._self = self._library.instance()
        self._state = ffi.new(f"{self._library.robot_name('state')} *")
        self._reference = ffi.new(f"{name('reference')} *")
        self._evaluation = ffi.new(f"{name('evaluation')} *")
        self._tau = ffi.new(f"{self._library.text.scalar.real}[{len(law.system.mechanism.inputs)}]")
        groups = [
            (f"{self._library.robot_name('params')} *", law.parameters, params),
            (f"{name('config')} *", law.config, config),
            (f"{name('gains')} *", law.gains, gains),
        ]
        structs = [self._filled(ffi.new(kind), quantities, values) for kind, quantities, values in groups]
        options = ffi.new(f"{self._library.robot_name('options')} *")  # all zero: no limits, zeros on an error
        if limits is not None:
            options.limit = [value if np.isfinite(value) else 0.0 for value in limits.torque]
            options.on_limit = ON_LIMIT.index(limits.mode)
        status = self._library.function("init")(self._self, *structs, options)
        self.refused = None if status == 0 else self._library.status(status)
        self._evaluate, self._step = self._library.function("evaluate"), self._library.function("step")
        self._status = cache(self._library.status)
        self._seen = [self._numbers(self._state), self._numbers(self._reference)]
        self._answer = self._numbers(self._tau)

    def evaluate(self, state: np.ndarray, reference: np.ndarray) -> Evaluation:
        """h, ydot, Phi, Phidot, u and tau at one state; no values unless the status is ok."""
        if self.refused:
            return Evaluation(self.refused, {})
        self._load(state, reference)
        status = self._evaluate(self._self, self._state, self._reference, self._evaluation)
        if status != 0:
            return Evaluation(self._status(status), {})
        return Evaluation("ok", {q: self._found[q].astype(float) if q in self._found else np.zeros(0) for q in QUANTITIES})

    def step(self, state: np.ndarray, reference: np.ndarray) -> tuple[str, np.ndarray]:
        """The controller's answer: status and inputs (N or N m), zeros on an error."""
        if self.refused:
            return self.refused, np.zeros(len(self._tau))
        self._load(state, reference)
        status = self._step(self._self, self._state, self._reference, self._tau)
        return self._status(status), self._answer.astype(float)

    def _load(self, state: np.ndarray, reference: np.ndarray) -> None:
        with np.errstate(over="ignore"):  # beyond float it is infinite, which the law refuses
            for numbers, values in zip(self._seen, (state, reference), strict=True):
                numbers[:] = values

    def _numbers(self, place) -> np.ndarray:
        """A struct of scalars, or an array of them, as an array in the same memory."""
        ffi = self._library.ffi
        return np.frombuffer(ffi.buffer(place), f"f{ffi.sizeof(self._library.text.scalar.real)}")

    @cached_property
    def _found(self) -> dict[str, np.ndarray]:
        """The vectors and matrices of the evaluation, in the same memory."""
        found = {}
        for name, _ in self._library.ffi.typeof(self._evaluation).item.fields:
            values = getattr(self._evaluation, name)
            found[name] = self._numbers(values).reshape((len(values), -1) if hasattr(values[0], "__len__") else -1)
        return found

    @staticmethod
    def _filled(struct, quantities, values):
        for quantity, value in zip(quantities, values, strict=True):
            setattr(struct, quantity.name, float(value))
        return struct
