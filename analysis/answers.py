"""The complete result of `noslip analyse` for a system, also as JSON."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from typing import Any

import sympy as sp

from ..codegen.loop.stages import check
from ..model.errors import ModelError
from ..model.law import default_gains, gain_names
from ..model.linearization import ASIDE, STEEPEST, linearize
from ..model.mechanism import Mechanism
from ..model.names import EXTENDED
from ..model.outputs import output_map, output_names
from ..model.reduction import ReducedSystem
from ..model.rolling.contact import PlanarContact, RollingContact, RollingGrowth, rolling_growth
from ..model.rolling.kinematics import Kinematics
from ..readers.errors import BadInput, naming
from ..readers.progress import Reported, silent
from ..readers.robots import check_law, find_robot, placed, system_of
from ..simulation.closed_loop import simulate
from ..simulation.contact import Grip, grip
from ..simulation.controllers.balance.steady import analyse_at_rest
from ..simulation.loop import make_loop
from ..simulation.specification.vary import read_varied
from .certification.safe_offsets import Offsets, safe_offsets
from .certification.safety import BASIS, SAFE, Verdict, certify, of_each
from .distributions import analysis as structure
from .distributions.distribution import distribution, provable
from .distributions.properties import Check
from .exact.readable import unsigned
from .exact.symbolic import symbolic, written
from .flatness.flatness import Flatness, flatness
from .outputs.confirmation import confirm
from .outputs.decoupling import decouple
from .outputs.normal_form import ExtendedForm, NormalForm, StraightMotion, normal_form
from .underactuated import verdicts

Contact = RollingContact | PlanarContact
System = Mechanism | Kinematics | Contact
ROLLING_BRACKETS = {  # brackets that span the space, by the dimension of Delta, without spin and with it
    2: (("s1", "s2"), ("[s1,s2]",), ("[s1,[s1,s2]]", "[s2,[s1,s2]]")),
    3: (("s1", "s2", "s3"), ("[s1,s3]", "[s2,s3]")),
}
KEPT = 16  # systems whose constraints are remembered
NO_INPUTS = "kinematics alone have no inputs, so nothing can be controlled"


@dataclass(frozen=True, eq=False)
class Constraints:
    """n coordinates, m constraints, k of them holonomic. `levels`: the brackets that each step adds; `notes`
    by title.

    `json`: the documented keys and further ones. Some rolling contacts have no `S`, no `proof` of the growth
    and no `flatness`.
    """

    n: int
    m: int
    k: int
    growth: tuple[int, ...]
    levels: tuple[tuple[str, ...], ...]
    notes: dict[str, list[str]]
    checks: tuple[Check, ...]
    json: dict[str, Any]
    S: sp.Matrix | None = None
    proof: tuple[str, ...] = ()
    controlled: str = ""  # the system to which the checks apply
    flatness: tuple[Flatness, ...] = ()
    no_flatness: str = ""  # why there is no verdict


@dataclass(frozen=True, eq=False)
class Answer:
    """`outputs` by law; `refused`: why a law does not apply to this system; `no_outputs`: why there is none;
    by file, `starts` and whether the wheels roll in the run from there. `at_rest`: what can be said of an
    underactuated robot there.
    """

    name: str
    about: str
    constraints: Constraints
    outputs: dict[str, NormalForm] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    no_outputs: str = ""
    starts: dict[str, Verdict] = field(default_factory=dict)
    rolling: dict[str, Grip] = field(default_factory=dict)
    tables: dict[str, Offsets] = field(default_factory=dict)
    at_rest: tuple[str, ...] = ()

    @property
    def refused_by_reason(self) -> dict[str, list[str]]:
        """Reason -> the laws that are rejected for it."""
        laws: dict[str, list[str]] = {}
        for law, reason in self.refused.items():
            laws.setdefault(reason, []).append(law)
        return laws

    @property
    def fails(self) -> bool:
        """Whether some start is not proved to be safe."""
        return any(verdict.kind != SAFE for verdict in self.starts.values())


def analyse(
    system: System,
    laws: Sequence[str] = (),
    starts: Sequence[str] = (),
    uncertainty: Mapping[str, float] | float = 0.0,
    table: bool = False,
    progress: Reported = silent,
) -> Answer:
    """Analyse a system with these of its laws, or all, and the starts in these files; `uncertainty` as for
    `start_verdict`; `table`: find the safe offsets of each start too.

    Raises ModelError and BadInput for what cannot be analysed, for a named law that is none of the system's,
    and for files that are no SPEC of it.
    """
    if isinstance(system, Mechanism) and system.carried:
        raise ModelError(
            f"{system.name}: a surface moves on which it rolls: the analysis judges constraints A qdot = 0; "
            "analyse the robot with the surface at rest"
        )
    for law in laws:
        if isinstance(system, Mechanism):
            check_law(system, law)
    verdicts = {file: start_verdict(system.name, file, uncertainty) for file in starts}
    with placed(system):
        constraints = (
            _of_contact(system, progress)
            if isinstance(system, Contact)
            else _of_distribution(system, progress)
        )
    outputs, refused, nothing = _outputs(system, laws, progress)
    constraints = _with_declared(constraints, system, outputs)
    tables = {file: start_offsets(file, uncertainty, progress) for file in starts} if table else {}
    rolling = {file: start_rolling(file) for file in starts}
    about = getattr(system, "about", "")
    return Answer(
        system.name,
        about,
        constraints,
        outputs,
        refused,
        nothing,
        verdicts,
        rolling,
        tables,
        _at_rest(system),
    )


def _with_declared(constraints: Constraints, system: System, forms: Mapping[str, NormalForm]) -> Constraints:
    """Return the constraints with the verdict that outputs which the robot declares are flat where none was
    found: with a dynamic extension they and their derivatives are the whole state, without coordinates on
    which nothing depends.
    """
    open_ = [each for each in constraints.flatness if each.check.verdict is not False and each.found is None]
    if not isinstance(system, Mechanism) or not open_:
        return constraints
    flatness, checks = constraints.flatness, constraints.checks
    for output in system.outputs:
        form = forms.get(output.name + EXTENDED) or (
            None if output.name in forms else _extended(system, output.name)
        )
        if not isinstance(form, ExtendedForm) or form.others or form.along:
            continue
        rows = ", ".join(row.name for row in form.decoupling.linearization.output.rows)
        reason = (
            f"{output.name}, an output that is declared, is flat: it and its derivatives are the whole state"
        )
        known: dict[str, Any] = {
            "verdict": True,
            "reason": reason,
            "reference": "its dynamic extension leaves no zero dynamics",
        }
        flatness = tuple(
            replace(each, check=replace(each.check, **known), missing=f"{rows}, of {output.name}")
            if each in open_ and set(each.without) == set(form.cyclic)
            else each
            for each in flatness
        )
        if not form.cyclic:
            checks = tuple(
                replace(each, **known)
                if each.name == "dynamic_feedback_linearizable" and each.verdict is None
                else each
                for each in checks
            )
    json = constraints.json | {"checks": [each.as_json() for each in checks]}
    return replace(constraints, flatness=flatness, checks=checks, json=json)


def _extended(system: Mechanism, name: str) -> NormalForm | None:
    """Return the normal form of an output with a dynamic extension; None if there is none."""
    try:
        return _form(system_of(system), name + EXTENDED)
    except ModelError:
        return None


def _at_rest(system: System) -> tuple[str, ...]:
    """Return what is said of an underactuated robot at rest at q = 0; empty for other systems."""
    if (
        not isinstance(system, Mechanism)
        or not 0 < len(system.inputs) < len(system.coordinates) - system.A.shape[0]
    ):
        return ()
    try:
        return tuple(verdicts(analyse_at_rest(system)))
    except (ModelError, RuntimeError) as error:
        return (f"not judged: {error}",)


def start_verdict(name: str, file: str, uncertainty: Mapping[str, float] | float = 0.0) -> Verdict:
    """Return whether the start of a SPEC of this robot avoids the singular set; nothing is compiled.

    `uncertainty`: relative, of the robot's parameters by name, or one for all. Raises BadInput for a file
    that is no SPEC of it.
    """
    spec = read_varied(file, {"simulation.backend": "casadi"})
    with naming(file, (BadInput, ModelError)):
        if find_robot(spec.robot).name != name:
            raise BadInput(f"robot = {spec.robot!r} is not {name}, which is analysed")
        check(spec, "analyse --start")
        loop = make_loop(spec)
        return certify(loop, spec, of_each(uncertainty, loop))


def start_rolling(file: str) -> Grip:
    """Whether the wheels roll in the run of a SPEC, as `noslip simulate` states it. Raises BadInput if it
    cannot be run."""
    spec = read_varied(file, {"simulation.backend": "casadi"})
    with naming(file, (BadInput, ModelError)):
        return grip(simulate(spec))


def start_offsets(
    file: str, uncertainty: Mapping[str, float] | float = 0.0, progress: Reported = silent
) -> Offsets:
    """The table of safe offsets of a SPEC.

    Raises BadInput for a file that is not a SPEC, and for a path without such a table.
    """
    spec = read_varied(file, {"simulation.backend": "casadi"})
    with naming(file, (BadInput, ModelError)):
        return safe_offsets(spec, of_each(uncertainty, make_loop(spec)), progress=progress)


def as_json(answer: Answer) -> dict[str, Any]:
    """The documented keys, and more."""
    starts = {
        file: _verdict_json(verdict) | {"rolling": answer.rolling[file].as_json()}
        for file, verdict in answer.starts.items()
    }
    return {
        **answer.constraints.json,
        "flatness": [each.as_json() for each in answer.constraints.flatness],
        **({"no_flatness": answer.constraints.no_flatness} if answer.constraints.no_flatness else {}),
        "flat_outputs": [found for each in answer.constraints.flatness if (found := each.outputs_as_json())],
        "outputs": {law: _output_json(form) for law, form in answer.outputs.items()},
        "refused": answer.refused,
        **({"no_outputs": answer.no_outputs} if answer.no_outputs else {}),
        **({"at_rest": list(answer.at_rest)} if answer.at_rest else {}),
        "starts": starts,
        **({"starts_basis": BASIS} if answer.starts else {}),
        **(
            {"tables": {file: asdict(table) for file, table in answer.tables.items()}}
            if answer.tables
            else {}
        ),
        **(next(iter(starts.values())) if len(starts) == 1 else {}),
    }


def _verdict_json(verdict: Verdict) -> dict[str, Any]:
    until = verdict.until if math.isfinite(verdict.until) else None
    entries = {"verdict": verdict.kind, "t": verdict.t, "margin": verdict.margin, "until": until}
    return {**entries, "parts": verdict.parts, "reason": verdict.reason}


def singular_when(form: NormalForm) -> list[str]:
    """Return the conditions under which Phi is singular, one per component; empty if it never is."""
    return [f"{c}{'' if c.confirmed else ' [not tried at a point]'}" for c in form.decoupling.conditions]


def damped_near(form: NormalForm) -> list[str]:
    """Return what a damped law does near its singular set, and what that costs;
    empty for other laws. See `Damping`."""
    if form.decoupling.linearization.damping is None:
        return []
    gains = dict(zip(gain_names(2), default_gains(2), strict=True))
    return [
        "where |x| < 1, x = c/band, c = cosine of the angle between n and the velocity a*omega that turning "
        "gives P_l:",
        f"distance'' = v_distance - (1 - x^2)^2*(e + {ASIDE:g}*kd*c*e'): the error is largest where the "
        "heading is normal",
        "e = part of distance'' that turning has to provide: v_distance + kd*c*a*omega less that of "
        "curvature and",
        "forward acceleration;",
        "e' = rate of the distance by forward motion; on a line, at a constant speed V, without turning:",
        f"|e| <= kp*|distance| + kd*|V|, with the default gains {gains['kp']:g} and {gains['kd']:g}: "
        f"{gains['kp'] + gains['kd']:g} m/s^2 at 1 m and 1 m/s",
        f"|acceleration of P_l by turning + kd*a*omega| <= {STEEPEST:.3f}*|e|/band + {ASIDE:g}*kd*|e'|",
    ]


def driven_straight(answer: Answer) -> list[str]:
    """Describe the motion of trailers and other joints, with the outputs of which it is true unless these are
    all; empty if there are none.
    """
    shapes: dict[tuple[str, ...], list[str]] = {}
    for law, form in answer.outputs.items():
        if form.moving and form.shape.names:
            v = form.decoupling.names["v"]
            note = (
                f"{v} is {form.shape.speed}; on a path of small curvature, the same coordinates converge "
                "and diverge"
            )
            shapes.setdefault((*form.shape.lines(), *([note] if form.shape.decided else [])), []).append(law)
    return [
        f"{', '.join(laws)}: {line}" if len(shapes) > 1 else line
        for lines, laws in shapes.items()
        for line in lines
    ]


def uncontrolled(form: NormalForm) -> str:
    """Return the coordinates that are not controlled, the zero dynamics and their stability, in a line.

    If no choice of coordinates is valid everywhere, there are two, such as y where a line is not parallel to
    the x axis, else x.
    """
    first, *others = form.charts
    kept = ", ".join(form.T[2])
    if not first.everywhere and others:
        decoupling = form.decoupling
        minor = (
            decoupling.written_out(first.minor)
            if decoupling.det_for_people != decoupling.det
            else first.minor
        )
        minor = unsigned(sp.fraction(sp.together(minor))[0])
        kept += f" where {written(minor)} != 0, else {', '.join(map(str, others[0].kept))}"
    return f"{kept}: zero dynamics {form.zero_dynamics}, {form.stability}"


# -- constraints ---------------------------------------------------------------------------------------------


_analysed: dict[Mechanism | Kinematics, Constraints] = {}  # a robot is often analysed again with other starts


def _of_distribution(system: Mechanism | Kinematics, progress: Reported) -> Constraints:
    if system not in _analysed:
        if len(_analysed) >= KEPT:
            del _analysed[next(iter(_analysed))]
        analysis = structure.analyse(system, progress)
        velocities = [q.name for q in system.quasi_velocities] if isinstance(system, Mechanism) else []
        _analysed[system] = _with_flatness(_as_constraints(analysis), analysis, velocities)
    return _analysed[system]


def _as_constraints(analysis: structure.Analysis) -> Constraints:
    basis, before = analysis.certificate.basis, (0, *analysis.growth)
    levels = tuple(tuple(basis[a:b]) for a, b in zip(before, analysis.growth, strict=False))
    notes = {
        "integrals": analysis.holonomic.text(),
        "changes": analysis.places.text(),
        "taken positive": list(analysis.assumed),
    }
    proof = tuple(analysis.certificate.text())
    json = analysis.as_json() | {"proof": list(proof)}
    ranks = analysis.n, analysis.m, analysis.k, analysis.growth
    return Constraints(*ranks, levels, notes, analysis.checks, json, analysis.S, proof, analysis.controlled)


def _with_flatness(
    constraints: Constraints, analysis: structure.Analysis, velocities: Sequence[str]
) -> Constraints:
    inputs = analysis.actuation
    if inputs is not None and not inputs.full:
        driven = f"the inputs drive {inputs.driven} of {inputs.dof} quasi-velocities"
        return replace(
            constraints,
            no_flatness=f"no verdict: the theorems are about q' = S nu with all of nu driven, {driven}",
        )
    return replace(constraints, flatness=flatness(analysis.distribution, velocities))


def _of_contact(contact: Contact, progress: Reported) -> Constraints:
    """Analyse as any distribution; if metrics have roots, by the structure equations only,
    which hold for any two surfaces."""
    growth, kinematics = rolling_growth(contact), contact.kinematics()
    rough = bool(distribution(kinematics).functions.roots)
    constraints = (
        _by_structure_equations(kinematics, growth) if rough else _of_distribution(kinematics, progress)
    )
    notes = {"because": [growth.reason], "special orbits": list(growth.special)}
    if contact.formal:
        notes["formal only"] = [contact.formal]
    notes = {title: lines for title, lines in notes.items() if lines}
    return replace(constraints, notes=constraints.notes | notes, json=constraints.json | {"rolling": notes})


def _by_structure_equations(system: Kinematics, growth: RollingGrowth) -> Constraints:
    k = growth.holonomic
    json = {
        "name": system.name,
        "coordinates": system.n,
        "constraints": system.m,
        "holonomic": k,
        "nonholonomic": system.m - k,
    }
    json |= {
        "growth": list(growth.vector),
        "integrals": [],
        "integrals_complete": not k,
        "input_state_linearizable": False,
    }
    notes = {}
    if growth.drops_where is not None:
        (where,) = symbolic(growth.drops_where, [*system.coordinates, *system.parameters], system.name)
        above, below = map(written, sp.fraction(sp.together(where)))
        notes["changes"] = [
            f"where the Gaussian curvatures at the contact are equal: ({above})/({below}) = 0"
        ]
    levels = ROLLING_BRACKETS[growth.vector[0]][: len(growth.vector)]
    return Constraints(system.n, system.m, k, growth.vector, levels, notes, (), json)


# -- outputs -------------------------------------------------------------------------------------------------


def _outputs(
    system: System, laws: Sequence[str], progress: Reported
) -> tuple[dict[str, NormalForm], dict[str, str], str]:
    """Laws with their normal forms, those refused with the reason, and why there is none at all."""
    if not isinstance(system, Mechanism):
        if laws:
            raise BadInput(f"{system.name}: {NO_INPUTS}; leave --output out")
        return {}, {}, NO_INPUTS
    try:
        reduced = system_of(system)
    except ModelError as error:
        if laws:
            raise
        return {}, {}, _reason(error, system)
    forms, refused = {}, {}
    selected = laws or output_names(system)
    for k, law in enumerate(selected):
        progress(k, len(selected), "outputs analysed")
        try:
            forms[law] = _form(reduced, law)
        except ModelError as error:
            if laws:
                raise
            refused[law] = _reason(error, system)
    reasons = set(refused.values())
    nothing = reasons.pop() if len(reasons) == 1 else "none of Types I to IV fits, nor of its own"
    return forms, refused, "" if forms else nothing


@lru_cache(maxsize=64)
def _form(system: ReducedSystem, law: str) -> NormalForm:
    with provable(system.mechanism.name):
        form = normal_form(decouple(linearize(system, output_map(system, law))))
    confirm(form)
    return form


def _reason(error: ModelError, system: Mechanism) -> str:
    """Return an error message without the place in a user's file and the names of robot and law."""
    cause = error.__cause__ if isinstance(error.__cause__, ModelError) else error
    message = str(cause).removeprefix(system.name).removeprefix(": ").removeprefix(", output ")
    law, colon, rest = message.partition(": ")
    return rest if colon and law in output_names(system) else message


def _output_json(form: NormalForm) -> dict[str, Any]:
    decoupling = form.decoupling
    z1, z2, z3 = form.T
    return {
        "relative_degree": list(decoupling.linearization.relative_degree),
        "det": written(decoupling.det_in_full),
        "singular_when": ", or ".join(singular_when(form)) or "nowhere",
        **({"damped": "; ".join(damped_near(form))} if damped_near(form) else {}),
        "zero_dynamics": "; ".join([uncontrolled(form), *map(str, form.moving), *_driven_straight(form)]),
        "det_short": written(decoupling.det_for_people),
        "where": {str(name): written(formula) for name, formula in decoupling.explained.items()}
        | decoupling.renamed,
        "conditions": [
            {"formula": written(c.formula), "words": c.words, "confirmed": c.confirmed}
            for c in decoupling.conditions
        ],
        "undefined_where": [written(expression) for expression in decoupling.undefined],
        "normal_form": {
            "z1": list(z1),
            "z2": list(z2),
            "z3": list(z3),
            "regular_where_not_zero": [written(form.charts[0].minor), written(decoupling.det)],
            "other_z3": [list(map(str, chart.kept)) for chart in form.charts[1:]],
        },
        "z3_rates": {name: written(rate) for name, rate in form.equations.items()},
        "stability": form.stability,
        "moving_reference": [_moving_json(form, each) for each in form.moving],
    }


def _driven_straight(form: NormalForm) -> list[str]:
    """Return what the lines of `moving` do not contain."""
    return form.shape.lines() if form.moving and form.shape.decided else []


def _moving_json(form: NormalForm, moving: StraightMotion) -> dict[str, Any]:
    return {
        "reference": moving.reference,
        "equation": moving.equation,
        "settles": moving.settles,
        "stable_when": moving.stable_when or None,
        "rate": None if moving.rate is None else written(moving.rate),
        "shape": {
            each.name: written(sp.Symbol(form.decoupling.names["V"]) * each.rate)
            for each in moving.shape.followers
        },
        "not_examined": [] if moving.shape.decided else list(moving.shape.names),
        "lever": None if moving.lookahead is None else written(moving.lookahead),
        "lever_default": None if moving.lookahead is None else form.decoupling.at_defaults(moving.lookahead),
    }
