"""Whether a start of path following avoids the singular set, decided before the run.

All motions that the start can lead to, with every value that the robot's parameters may have, are enclosed
(`certificate`), in the loop that `simulate` runs: sampled or continuous, delayed, limited, with integral
action. A start is

- safe, where the enclosure stays regular: up to the end of the run, or for ever where the set of motions
  returns into itself;
- singular, where the motion with the given parameters is, every motion of the enclosure approaches the
  singular set at the last instant that is enclosed, and so do the runs at the two ends of the ranges of the
  parameters;
- an unstable equilibrium, where the nominal motion rests at one: when it leaves is decided by rounding;
- not proved otherwise.

A start that is not proved is tried again in parts: the range of the parameter that widens the enclosure most
is halved, and each half again where needed. It is safe or singular if all parts are.

`BASIS` says what is bounded and what is estimated. Damped laws and those with a dynamic extension are judged
by `regularity`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ...readers.errors import BadInput
from ...readers.reading import check_keys
from ...simulation.integrate import Row, continuous, sampled
from ...simulation.loop import RUNNING, Loop, make_loop
from ...simulation.specification.spec import Spec
from .certificate import Certificate, Course
from .enclosed_loop import EnclosedLoop
from .regularity import begins_everywhere, centres, proof_of_motion, why_no_closed_form

SAFE, SINGULAR, NOT_PROVED, UNSTABLE = KINDS = ("safe", "singular", "not proved", "unstable equilibrium")
BASIS = {
    "bounded": "every state between the steps, the uncertain parameters, limits, and where pieces of a path "
    "join",
    "estimated": "the error of each step of integration, by the embedded method, and rounding; both are "
    "added in full",
    "neglected": "the error of integration of the derivatives of the motion by its start and by the "
    "parameters",
}
HALVINGS = 3  # of the range of the parameters, at most 8 parts
NEAR = 0.5  # s: a motion that needs longer to become singular at its present rate may still turn away


@dataclass(frozen=True)
class Verdict:
    """`kind` is one of KINDS; `reason` a sentence; `t` (s) when the nominal motion will be singular.

    `margin`: a lower bound of |det Phi| over the product of its row norms, of all motions up to `until` (s;
    infinite: for ever). `parts`: into how many the range of the parameters was split for the proof. `course`:
    t (s) and s of the nominal motion as far as it was followed with the whole range, 2 x N.
    """

    kind: str
    reason: str
    t: float | None = None
    margin: float | None = None
    until: float = 0.0
    parts: int = 1
    course: np.ndarray = field(default_factory=lambda: np.zeros((2, 0)), compare=False, repr=False)

    def __str__(self) -> str:
        """Return the verdict as text."""
        words = "will be singular" if self.kind == SINGULAR else self.kind
        return f"{words}: {self.reason}"


def certify(loop: Loop, spec: Spec, uncertainty: Mapping[str, float] | None = None) -> Verdict:
    """Return the verdict on a start. `uncertainty`: relative deviations of the robot's parameters, by name.

    Raises BadInput for an unknown parameter and for a size that is not in [0, 1).
    """
    uncertainty = dict(uncertainty or {})
    check_uncertainty(uncertainty, loop)
    if loop.law.linearization.damping is not None:
        return _damped(loop, spec)
    if loop.law.extension:
        return _extended(loop, spec, uncertainty)
    doubts = [
        (loop.law.output.path is None, "the outputs are not those of path following"),
        (loop.sensing is not None, "the controller does not see the true state"),
        (spec.reference.approach is not None, "the desired distance is that of an approach"),
        (spec.reference.profiled, "the desired speed is that of a profile"),
        (loop.drive.commands > 0, "the drives follow velocities with a loop of their own"),
        (
            loop.limits is not None and loop.limits.mode == "grip",
            "the limiter of friction changes the inputs",
        ),
        (bool(loop.observers.rows), "the loop has disturbance observers"),
        (loop.limits is not None and bool(loop.integral.rows), "limits decide when integral action stops"),
    ]
    for applies, why in doubts:
        if applies:
            return Verdict(NOT_PROVED, f"{why}, which this proof does not cover")
    try:
        enclosed = EnclosedLoop(loop, spec, uncertainty)
    except BadInput as error:
        return Verdict(NOT_PROVED, str(error))
    proof = Certificate(enclosed, spec.simulation).run()
    verdict = _verdict(enclosed, spec, proof)
    parts = _parts(enclosed, spec, proof, HALVINGS) if verdict.kind == NOT_PROVED else {}
    return _together(enclosed, spec, parts, verdict) if len(parts) == 1 else verdict


def _damped(loop: Loop, spec: Spec) -> Verdict:
    """Return the verdict on a start of a damped law, which has no singular set:
    whether the distance has a gradient."""
    margin = loop.guidance.leg.side.relative(loop.start)
    if not begins_everywhere(loop.law):
        return Verdict(
            NOT_PROVED, "what the damped law inverts depends on the state, which this proof does not cover"
        )
    if centres(loop, spec):
        reason = (
            "the damped law begins from every start but where the distance has no gradient, as in the "
            "centre of a circle"
        )
        return Verdict(
            NOT_PROVED, f"{reason}; that the motion does not meet such a point is not proved", None, margin
        )
    reason = (
        "the damped law begins from every start: what it inverts is the same in all states; whether it "
        "reaches the path is not "
    )
    return Verdict(SAFE, reason + "judged", None, margin, np.inf)


def _extended(loop: Loop, spec: Spec, uncertainty: Mapping[str, float]) -> Verdict:
    """Return the verdict on a start of a law with a dynamic extension."""
    margin = loop.guidance.leg.side.relative(np.append(loop.start, loop.extension))
    along = loop.law.output.path is not None
    what = "|speed| - |rate of the distance|" if along else "the speed of P_l"
    if not (why := why_no_closed_form(loop, spec, uncertainty)):
        proof = proof_of_motion(loop, spec)
        if not proof.lost:
            when = "for ever" if np.isinf(proof.until) else f"for the {proof.until:.6g} s of the run"
            reason = f"{what} stays above {np.floor(1e4 * proof.least) / 1e4:.4f} m/s {when}"
            return Verdict(SAFE, reason, None, None, proof.until)
        why = f"{what}: {proof.lost}"
    last = _run(spec, {}, spec.simulation.duration)
    if last.status == "singular":
        where = ", or the heading becomes normal to the path," if along else ""
        where += " or what is integrated has a pole" if "joints" in why else ""
        exact = not any(uncertainty.values())
        reason = (
            f"P_l stands still{where} at t = {last.t:.4g} s{'' if exact else ' with the given parameters'}"
        )
        return Verdict(SINGULAR if exact else NOT_PROVED, reason, last.t if exact else None, 0.0, last.t)
    covers = "" if ":" in why else ", which this proof does not cover"
    goes_on = "the law begins here, and the run with the given parameters stays regular"
    return Verdict(NOT_PROVED, f"{why}{covers}; {goes_on} up to t = {last.t:.4g} s", None, margin)


def _verdict(enclosed: EnclosedLoop, spec: Spec, proof: Course) -> Verdict:
    """Return the verdict that follows from one course."""
    course = np.array([proof.t, proof.s])
    if proof.unstable:
        reason = (
            "the motion rests at an equilibrium of the loop that is not stable; when it leaves is "
            "decided by rounding"
        )
        return Verdict(UNSTABLE, reason, None, proof.margin, proof.until, course=course)
    return _lost(enclosed, spec, proof, course) if proof.lost else _safe([proof], course)


def _singular(enclosed: EnclosedLoop) -> str:
    """Return what happens where a law along a path is singular."""
    loses = enclosed.loop.law.linearization.measures[1:]
    return "the heading becomes normal to the path" + (", or inputs lose a direction," if loses else "")


def _safe(courses: list[Course], course: np.ndarray) -> Verdict:
    """Return the verdict if no course is lost; there is one for each part of the range of the parameters."""
    until = min(np.inf if each.invariant else each.until for each in courses)
    when = "for ever" if np.isinf(until) else f"for the {until:.6g} s of the run"
    reason = (
        f"|s| stays below {np.ceil(1e4 * max(each.largest for each in courses)) / 1e4:.4f} "
        f"{when}{_split(len(courses))}"
    )
    return Verdict(SAFE, reason, None, min(each.margin for each in courses), until, len(courses), course)


def _split(parts: int) -> str:
    """Return the number of parts as text."""
    return f", proved for {parts} parts of the range of the parameters one by one" if parts > 1 else ""


def _parts(enclosed: EnclosedLoop, spec: Spec, proof: Course, halvings: int) -> dict[str, list[Course]]:
    """Return the courses of parts that cover the range of the parameters, by their verdict, SAFE or SINGULAR.
    Unless all have the same verdict, the result is empty or has both. `proof` is the course that is not
    proved for the whole range.
    """
    if not halvings or proof.shares is None or proof.approach is None or not proof.shares.any():
        return {}
    which = int(np.argmax(proof.shares))
    first = proof.approach[which] or 1.0  # the half nearer to the singular set, which fails sooner
    parts: dict[str, list[Course]] = {}
    for side in (first, -first):
        half, changed = enclosed.half(spec, which, side)
        course = Certificate(half, changed.simulation).run()
        kind = _verdict(half, changed, course).kind
        more = {kind: [course]} if kind in (SAFE, SINGULAR) else _parts(half, changed, course, halvings - 1)
        if len(more) != 1:
            return {}
        for kind, courses in more.items():
            parts.setdefault(kind, []).extend(courses)
        if len(parts) != 1:
            break
    return parts


def _together(enclosed: EnclosedLoop, spec: Spec, parts: dict[str, list[Course]], whole: Verdict) -> Verdict:
    """Return the verdict from parts of one kind; `whole` is that of the whole range, not proved."""
    ((kind, courses),) = parts.items()
    if kind == SAFE:
        return _safe(courses, whole.course)
    last, until = _run(spec, {}, spec.simulation.duration), min(each.until for each in courses)
    if last.status != "singular":
        return whole
    reason = f"{_singular(enclosed)} at t = {last.t:.4g} s, with other parameters after {until:.4g} s"
    return Verdict(SINGULAR, reason + _split(len(courses)), last.t, 0.0, until, len(courses), whole.course)


def check_uncertainty(uncertainty: Mapping[str, float], loop: Loop) -> None:
    """Raise BadInput for an unknown parameter and for a size that is not in [0, 1)."""
    check_keys(uncertainty, [q.name for q in loop.law.parameters], "uncertainty")
    for name, size in uncertainty.items():
        if not 0 <= size < 1:
            raise BadInput(
                f"uncertainty {name} = {size:g} must lie between 0 and 1: it is relative to the parameter"
            )


def of_each(uncertainty: Mapping[str, float] | float, loop: Loop) -> Mapping[str, float]:
    """Return the uncertainty of each of the robot's parameters,
    from one for all or from those given by name."""
    if isinstance(uncertainty, Mapping):
        return uncertainty
    return {q.name: uncertainty for q in loop.law.parameters}


def _lost(enclosed: EnclosedLoop, spec: Spec, proof: Course, course: np.ndarray) -> Verdict:
    """Return whether the proof failed because all motions become singular."""
    last = _run(spec, {}, proof.until + NEAR)
    proved = (
        f"|s| stays below {np.ceil(1e4 * proof.largest) / 1e4:.4f} up to t = {proof.until:.4g} s"
        if proof.t
        else "nothing"
    )
    if last.status != "singular":
        reason = f"{proof.lost}; what is proved is that {proved}" if proof.t else proof.lost
        return Verdict(NOT_PROVED, reason, None, proof.margin, proof.until, course=course)
    ends = [last]
    if len(enclosed.spread) and proof.approach is not None:
        ends += [
            _run(spec, enclosed.plant_at(side * proof.approach), proof.until + NEAR) for side in (-1.0, 1.0)
        ]
    if proof.approaching and all(row.status == "singular" for row in ends):
        times = [row.t for row in ends]
        spread = (
            ""
            if len(ends) == 1
            else f", with other parameters between {proof.until:.4g} and {max(times):.4g} s"
        )
        reason = f"{_singular(enclosed)} at t = {last.t:.4g} s{spread}"
        return Verdict(SINGULAR, reason, last.t, 0.0, proof.until, course=course)
    reason = f"with the given parameters {_singular(enclosed)} at t = {last.t:.4g} s, with others it may not"
    return Verdict(NOT_PROVED, reason, None, 0.0, proof.until, course=course)


def _run(spec: Spec, plant: Mapping[str, float], end: float) -> Row:
    """Return the last row of a run with other parameters of the robot, up to `end` (s) or until it stops."""
    duration = min(end, spec.simulation.duration)
    simulation = replace(spec.simulation, duration=duration, output_step=duration, backend="casadi")
    changed = replace(spec, plant={**spec.plant, **plant}, simulation=simulation)
    integrate = sampled if simulation.period else continuous
    for row in integrate(make_loop(changed), simulation):  # noqa: B007
        if row.status not in RUNNING:
            break
    return row
