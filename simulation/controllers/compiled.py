"""Controllers and dynamics computed by the generated C, in double or float."""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from functools import cache, cached_property, lru_cache
from itertools import islice
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from ...codegen.identity import DYNAMICS, banner, details, fingerprint
from ...codegen.printing.scalar import SCALARS, Scalar
from ...model.law import ControlLaw
from ...model.reduction import ReducedSystem
from ...readers.errors import check_status
from ...readers.kept import remembered
from .controller import ON_LIMIT, RUNNING, Evaluation, Limits, check_point
from .runtime import InC, knowing, load, runtime

if TYPE_CHECKING:
    from ...codegen.printing.dynamics_c import DynamicsC
    from ...codegen.printing.law_c import LawC
    from ...codegen.program import Entry


class _Compiled(InC):
    """Compiled C of a robot in one scalar: `ffi` has its types, `lib` its functions, `files` its text."""

    def __init__(
        self,
        system: ReducedSystem,
        name: str,
        scalar: Scalar,
        identity: tuple[str, ...],
        written: Mapping[str, str] | None,
    ):
        """`name` follows the robot's in C, `identity` says all on which the C depends; `written` as for
        `Library`."""
        self.system, self.scalar, self.robot = system, scalar, system.mechanism.name
        self.prefix = f"{self.robot}_{name}"
        if written:
            declared, self.files = self._declared(), written
        else:
            key = "C", scalar.real, *identity
            declared, self.files = remembered(key, lambda: (self._declared(), self._written()))
        self.ffi = knowing(declared + self._more())
        self.lib = load(self.ffi, self.files)

    @cached_property
    def text(self) -> "LawC | DynamicsC":
        """What writes the C; it is derived when it is asked for."""
        raise NotImplementedError

    def _declared(self) -> str:
        """Return the declarations, for cffi."""
        from ...codegen.printing.law_c import runtime_types
        from ...codegen.printing.robot_c import robot_declarations

        status = "const char *noslip_status_name(int status);"
        shared = [status, runtime_types(self.scalar), robot_declarations(self.system, self.scalar)]
        return "\n".join([*shared, self.text.declarations()])

    def _written(self) -> dict[str, str]:
        """Return the files, with those that they use."""
        from ...codegen.files import shared_files, text_files

        return {**shared_files(self.system, self.scalar), **text_files(self.text)}

    def _more(self) -> str:
        """Return further declarations."""
        return ""

    @cached_property
    def _lengths(self) -> dict[str, int]:
        """Numbers of fields of structs, by kind, as far as they have been asked for."""
        return {}

    def name(self, name: str) -> str:
        """Return the C name of something of this law or dynamics."""
        return self.scalar.name(f"{self.prefix}_{name}" if name else self.prefix)

    def robot_name(self, name: str) -> str:
        """Return the C name of something that the robot's laws share."""
        return self.scalar.name(f"{self.robot}_{name}")

    def instance(self):
        """Return a law, or dynamics, that is not yet initialized."""
        return self.ffi.new(f"{self.name('')} *")

    def function(self, name: str):
        """Return an entry point."""
        return getattr(self.lib, self.name(name))

    def struct(self, kind: str, values: Iterable[float]):
        """Return a new C struct of scalars, filled in the order of its fields."""
        if kind not in self._lengths:
            self._lengths[kind] = len(self.ffi.typeof(kind).fields)
        return self.ffi.new(f"{kind} *", [float(value) for value in islice(values, self._lengths[kind])])

    def array(self, values: Iterable[float]):
        """Return a new C array of scalars."""
        return self.ffi.new(f"{self.scalar.real}[]", [float(value) for value in values])

    def numbers(self, place) -> np.ndarray:
        """Return a struct or array of scalars as a NumPy array in the same memory."""
        return np.frombuffer(self.ffi.buffer(place), f"f{self.ffi.sizeof(self.scalar.real)}")


class Library(_Compiled):
    """The compiled C of one law in one scalar."""

    def __init__(self, law: ControlLaw, scalar: str, written: Mapping[str, str] | None = None):
        """`written`: files that are there already, by name, these among them; they make one library."""
        self._law = law
        identity = *banner(fingerprint(law.system, law)), details(law)
        super().__init__(law.system, law.name, SCALARS[scalar], identity, written)

    @cached_property
    def text(self) -> "LawC":
        """See _Compiled."""
        from ...codegen.files import law_program, law_text  # slow to import

        return law_text(law_program(self._law), self.scalar)

    @staticmethod
    def believed(instance) -> float:
        """Return the friction that a law believes."""
        return float(instance.earned.mu)

    def set_friction(self, instance, mu: float) -> None:
        """Let a law believe `mu` at most, as noslip_slip_grip does."""
        c, scalar, name = runtime("noslip_grip.h"), self.scalar.real, self.scalar.name
        places = (
            c.ffi.cast(
                f"{name(f'noslip_{part}')} *",
                int(self.ffi.cast("uintptr_t", self.ffi.addressof(instance, part))),
            )
            for part in ("earned", "grip")
        )
        c.function("noslip_believe_at_most", scalar)(*places, mu)


class BatchLibrary(Library):
    """The compiled C of one law and of its batch law in one scalar, from files that are there already."""

    def _more(self) -> str:
        from ...codegen.files import law_program
        from ...codegen.printing.lanes_c import LanesC

        return LanesC(law_program(self._law), self.scalar, []).declarations()


class DynamicsLibrary(_Compiled):
    """The compiled C of a robot's dynamics in one scalar."""

    def __init__(self, system: ReducedSystem, scalar: str, written: Mapping[str, str] | None = None):
        """`written` as for `Library`."""
        identity = *banner(fingerprint(system)), DYNAMICS
        super().__init__(system, DYNAMICS, SCALARS[scalar], identity, written)

    @cached_property
    def text(self) -> "DynamicsC":
        """See _Compiled."""
        from ...codegen.files import dynamics_program, dynamics_text  # slow to import

        return dynamics_text(dynamics_program(self.system), self.scalar)


@lru_cache(maxsize=64)
def library(law: ControlLaw, scalar: str) -> Library:
    """Return the law's compiled C, loaded once per process."""
    return Library(law, scalar)


@lru_cache(maxsize=16)
def dynamics_library(system: ReducedSystem, scalar: str) -> DynamicsLibrary:
    """Return the compiled C of a robot's dynamics, loaded once per process."""
    return DynamicsLibrary(system, scalar)


class CompiledController:
    """One instance of a generated law: its struct, initialized with parameters, configuration, gains and
    limits.

    If init returns an error, it is kept as `refused`, and every call returns it, as in firmware.
    """

    def __init__(
        self,
        law: ControlLaw,
        params: Iterable[float],
        config: Iterable[float],
        gains: Iterable[float],
        scalar: str = "double",
        limits: Limits | None = None,
        made_by: Library | None = None,
    ):
        """`made_by`: the library of the law, if it is not that of this host and scalar."""
        self.law = law
        self._library = made_by or library(law, scalar)
        ffi, name = self._library.ffi, self._library.name
        self._self = self._library.instance()
        self._state = ffi.new(f"{self._library.robot_name('state')} *")
        self._reference = ffi.new(f"{name('reference')} *")
        fields = ("extension", "extension_rate") if law.extension else ()
        self._extension = [self._library.numbers(getattr(self._self, field)) for field in fields]
        self._dt = (0.0,) if law.extension else ()
        self._evaluation = ffi.new(f"{name('evaluation')} *")
        self._tau = ffi.new(f"{self._library.scalar.real}[{len(law.inputs)}]")
        self._quantities = tuple(law.quantities)
        groups = [
            (self._library.robot_name("params"), params),
            (name("config"), config),
            (name("gains"), gains),
        ]
        structs = [self._library.struct(kind, values) for kind, values in groups]
        # All zero: no limits, zeros on an error
        options = ffi.new(f"{self._library.robot_name('options')} *")
        if limits is not None:
            for k, value in enumerate(limits.torque):
                options.limit[k] = value if np.isfinite(value) else 0.0
            options.on_limit = ON_LIMIT.index(limits.mode)
            if limits.mode == "grip" and limits.friction:
                options.friction = dataclasses.asdict(limits.friction)
        self._given = [*structs, options]
        self._friction = limits.friction if limits and limits.mode == "grip" else None
        status = self._library.function("init")(self._self, *structs, options)
        self.refused = None if status == 0 else self._library.status(status)
        self._evaluate, self._step = self._library.function("evaluate"), self._library.function("step")
        self._status = cache(self._library.status)
        self._seen = [self._library.numbers(self._state), self._library.numbers(self._reference)]
        self._answer = self._library.numbers(self._tau)
        self._lock = Lock()

    def evaluate(self, state: np.ndarray, reference: np.ndarray) -> Evaluation:
        """Return the quantities of the law at one state, such as h, Phi and tau;
        no values unless the status is ok."""
        check_point(self.law, state, reference)
        if self.refused:
            return Evaluation(self.refused, {})
        with self._lock:
            self._load(state, reference)
            status = self._evaluate(self._self, self._state, self._reference, self._evaluation)
            if status != 0:
                return Evaluation(self._status(status), {})
            found = self._found
            return Evaluation(
                "ok", {q: found[q].astype(float) if q in found else np.zeros(0) for q in self._quantities}
            )

    def step(self, state: np.ndarray, reference: np.ndarray) -> tuple[str, np.ndarray]:
        """Return status and what the law gives, see Controller; zeros on an error."""
        check_point(self.law, state, reference)
        if self.refused:
            return self.refused, np.zeros(len(self._tau))
        with self._lock:
            self._load(state, reference)
            status = self._step(self._self, self._state, self._reference, *self._dt, self._tau)
            return self._status(status), self._answer.astype(float)

    def steps(self, state: np.ndarray, reference: np.ndarray) -> tuple[list[str], np.ndarray]:
        """Return status and what the law gives, a row for each input, of n lanes; of a law of a
        `BatchLibrary`.

        `state` and `reference` have a row for each member and a column for each lane, in the scalar of the
        law.
        """
        library, count = self._library, state.shape[1]
        tau, status = np.zeros((len(self._tau), count), state.dtype), np.zeros(count, np.int32)
        arrays = (np.ascontiguousarray(state), np.ascontiguousarray(reference), tau)
        given = [library.ffi.from_buffer(f"{library.scalar.real}[]", array) for array in arrays]
        library.function("steps")(self._self, count, *given, library.ffi.from_buffer("int[]", status))
        return [self._status(number) for number in status.tolist()], tau

    @property
    def believed(self) -> float:
        """See Controller."""
        return self._library.believed(self._self) if self._friction else math.nan

    def believe(self, mu: float) -> None:
        """See Controller."""
        assert self._friction is not None, "there is friction in mode grip only"
        with self._lock:
            self._library.set_friction(self._self, mu)

    def adapt(self, params: Iterable[float]) -> None:
        """See Controller: by the init and update of the law."""
        self._given[0] = self._library.struct(self._library.robot_name("params"), params)
        check_status(self._renewed(), f"{self.law.name}: update to other parameters")

    def place(self, config: Iterable[float]) -> None:
        """See Controller: by the init and update of the law."""
        self._given[1] = self._library.struct(self._library.name("config"), config)
        status = self._renewed()
        self.refused = None if status == "ok" else status

    def _renewed(self) -> str:
        """Return the status of an update of the law to what is given now."""
        following = self._library.instance()
        status = self._library.function("init")(following, *self._given)
        with self._lock:
            status = status or self._library.function("update")(self._self, following)
        return self._library.status(status)

    @property
    def extension_rate(self) -> np.ndarray:
        """See Controller."""
        return self._extension[1].astype(float) if self._extension else np.zeros(0)

    def entry(
        self, entry: "Entry", state: np.ndarray, foot: Iterable[float] = (), more: Iterable[float] = ()
    ) -> Evaluation:
        """Return the quantity that an entry point computes. `more`: the reference,
        virtual input or inputs that it takes."""
        from ...codegen.graph import Group  # slow to import

        if self.refused:
            return Evaluation(self.refused, {})
        library = self._library
        ((quantity, matrix),) = library.text.program.entries[entry].quantities.items()
        given = [library.struct(library.scalar.name("noslip_foot"), foot)] if entry.at_foot else []
        given.append(library.struct(library.robot_name("state"), state))
        if entry.takes is Group.REFERENCE:
            given.append(library.struct(library.name("reference"), more))
        elif entry.takes in (Group.VIRTUAL_INPUT, Group.INPUT):
            given.append(library.array(more))
        answer = library.array(np.zeros(len(matrix) * len(matrix[0])))
        place = library.ffi.cast(library.ffi.typeof(library.function(entry.name)).args[-1], answer)
        with self._lock:
            self._load_extension(state)
            status = self._status(library.function(entry.name)(self._self, *given, place))
        values = library.numbers(answer).reshape(len(matrix), -1).astype(float)
        return Evaluation(status, {quantity: values} if status in RUNNING else {})

    def _load(self, state: np.ndarray, reference: np.ndarray) -> None:
        if self._answer.dtype == np.float64:
            self._fill(state, reference)
        else:  # values too large for float become infinite, which the law rejects
            with np.errstate(over="ignore"):
                self._fill(state, reference)

    def _fill(self, state: np.ndarray, reference: np.ndarray) -> None:
        seen, wanted = self._seen
        seen[:] = state[: len(seen)]
        wanted[:] = reference
        self._load_extension(state)

    def _load_extension(self, state: np.ndarray) -> None:
        """Set the states of the extension, the last of the state."""
        if self._extension:
            self._extension[0][:] = state[len(self._seen[0]) :]

    @cached_property
    def _found(self) -> dict[str, np.ndarray]:
        """Return the vectors and matrices of the evaluation, in the same memory."""
        found = {}
        for name, _ in self._library.ffi.typeof(self._evaluation).item.fields:
            values = getattr(self._evaluation, name)
            found[name] = self._library.numbers(values).reshape(
                (len(values), -1) if hasattr(values[0], "__len__") else -1
            )
        return found


class CompiledDynamics:
    """The generated dynamics of a robot with their own memory, initialized with parameters (SI)."""

    def __init__(self, made_by: DynamicsLibrary, params: Iterable[float]):
        self._library = made_by
        self._self = made_by.instance()
        status = made_by.status(
            made_by.function("init")(self._self, made_by.struct(made_by.robot_name("params"), params))
        )
        self.refused = None if status == "ok" else status

    def entry(self, entry: "Entry", state: Iterable[float], tau: Iterable[float]) -> Evaluation:
        """Return the flattened result of an entry point at a state [q; nu] with the inputs tau (N or N m),
        which not all of them use.
        """
        if self.refused:
            return Evaluation(self.refused, {})
        library, ffi = self._library, self._library.ffi
        given = [
            library.struct(library.robot_name("state"), state),
            *([library.array(tau)] if entry.takes else []),
        ]
        evaluation = ffi.new(f"{library.name('evaluation')} *")
        places = {name: getattr(evaluation, name, None) for name in entry.answers}
        if entry.whole:
            answers = [evaluation]
        else:
            places = {
                name: place if place is not None else library.array(self._empty())
                for name, place in places.items()
            }
            answers = list(places.values())
        status = library.status(library.function(entry.name)(self._self, *given, *answers))
        found: dict[str, np.ndarray] = {
            name: library.numbers(place).astype(float) for name, place in places.items()
        }
        return Evaluation(status, found if status == "ok" else {})

    def _empty(self) -> np.ndarray:
        return np.zeros(self._library.system.dof)
