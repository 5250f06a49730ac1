"""Theorems 1 to 3 of the paper as checks, for the system qdot = S nu, nudot = u (13) on R^(2n-m), and on a
leaf of Delta*.

A leaf is a set on which the k integrals are constant: n - k dimensions of q, 2n - m - k of the state.
"""

from dataclasses import dataclass, replace

from .actuation import Actuation
from .distribution import Distribution

SPACE, LEAF = "R^(2n-m)", "leaf"
SUSSMANN = (
    "H. J. Sussmann, A general theorem on local controllability, SIAM J. Control Optim. 25(1), 1987; A. M. "
    "Bloch, M. Reyhanoglu, N. H. McClamroch, Control and stabilization of nonholonomic dynamic systems, IEEE "
    "TAC 37(11), 1992"
)
BROCKETT = "R. W. Brockett, Asymptotic stability and feedback stabilization, 1983"
LINEARIZABLE = ("input_state_linearizable", "dynamic_feedback_linearizable")
ONE_IS_STATIC = (
    "B. Charlet, J. Levine, R. Marino, On dynamic feedback linearization, Systems & Control Letters 13, 1989"
)
ISIDORI = (
    "A. Isidori, Nonlinear Control Systems, 1989: the conditions for exact linearization by static feedback"
)
TWO_INPUTS = (
    "P. Martin, P. Rouchon, Feedback linearization and driftless systems, Math. Control Signals "
    "Systems 7, 1994"
)
CODIMENSION_TWO = (
    "P. Martin, P. Rouchon, Any (controllable) driftless system with m inputs and m+2 states "
    "is flat, IEEE CDC 1995"
)
ONE_INPUT = (
    "H. J. Sussmann, Lie brackets and local controllability: a sufficient condition for scalar-input "
    "systems, SIAM J. Control Optim. 21(3), 1983"
)
SYMMETRIC = "A. D. Lewis, Simple mechanical control systems with constraints, IEEE TAC 45(8), 2000"
ACCESSIBILITY = (
    "H. J. Sussmann, V. Jurdjevic, Controllability of nonlinear systems, J. Differential Equations 12, 1972"
)
JAKUBCZYK = "B. Jakubczyk, W. Respondek, On linearization of control systems, Bull. Acad. Pol. Sci. 28, 1980"
NOETHER = "Noether's theorem: A. M. Bloch, Nonholonomic Mechanics and Control, 2003, section 5.5"
PFAFF = "the normal form of Pfaff and Darboux of one one-form"


@dataclass(frozen=True)
class Hypothesis:
    """A hypothesis of a theorem; `holds` is None if the user must verify it."""

    text: str
    holds: bool | None


@dataclass(frozen=True)
class Check:
    """A question, about R^(2n-m) or the leaf; `verdict` None means that the theorems used here do not answer
    it."""

    name: str
    question: str
    where: str
    verdict: bool | None
    reason: str
    hypotheses: tuple[Hypothesis, ...]
    reference: str

    def text(self) -> str:
        """Return the check as one line."""
        answer = {True: "yes", False: "no", None: "not decided"}[self.verdict]
        return (
            f"{self.question} (on {'the leaf' if self.where == LEAF else self.where}): {answer}, "
            f"{self.reason} [{self.reference}]"
        )

    def as_json(self) -> dict[str, str | bool | None]:
        """Return plain data."""
        kept = {"name": self.name, "on": self.where, "verdict": self.verdict}
        return {**kept, "reason": self.reason, "reference": self.reference}


@dataclass(frozen=True)
class LinearizationStep:
    """One of the distributions D_1, D_2, ... of (13), D_(i+1) = D_i + [f, D_i]."""

    name: str
    dimension: int
    involutive: bool
    reason: str


def linearization_steps(Delta: Distribution) -> tuple[LinearizationStep, ...]:
    """Return D_1 = span{g}, D_2 = span{g, [f, g]} of (13), at generic states; all after D_2 equal it if it is
    involutive.

    g_j = d/dnu_j is constant, and [f, g_j] = -s_j: D_2 consists of the directions of the quasi-velocities and
    Delta.
    """
    inputs = len(Delta.fields)
    involutive = len(Delta.growth) == 1
    reason = (
        "Delta is involutive"
        if involutive
        else f"Delta is not: [Delta, Delta] has dimension {Delta.growth[1]}"
    )
    return (
        LinearizationStep("D_1", inputs, True, "its fields are constant"),
        LinearizationStep(
            "D_2", 2 * inputs, involutive, f"it contains Delta and constant fields, and {reason}"
        ),
    )


def checks(Delta: Distribution, inputs: Actuation | None = None) -> tuple[Check, ...]:
    """Return all checks, each on R^(2n-m), and on the leaf if k > 0.

    They apply to the robot driven by its `inputs`; None: to (13), whose inputs drive every quasi-velocity.
    """
    where = (SPACE, LEAF) if Delta.holonomic else (SPACE,)
    table = [
        (_accessible, where),
        (_controllable, where),
        (_lagrange, (SPACE,)),
        (_asymptotic, where),
        (_static, where),
    ]
    of_13 = tuple(check(Delta, place) for check, places in table for place in places) + (
        linearizable_dynamically(Delta),
    )
    driven = Hypothesis(
        "S'E has rank n - m: the inputs drive every quasi-velocity, generic, by numbers",
        None if inputs is None else inputs.full,
    )
    of_13 = tuple(replace(check, hypotheses=(driven, *check.hypotheses)) for check in of_13)
    return (
        of_13
        if inputs is None or inputs.full
        else tuple(_underactuated(Delta, check, inputs) for check in of_13)
    )


def _underactuated(Delta: Distribution, check: Check, inputs: Actuation) -> Check:
    """Return the check if inputs do not drive all quasi-velocities: the robot cannot do what (13) cannot;
    the rest is open."""
    reached, states = inputs.reached, 2 * Delta.functions.n - Delta.m - Delta.holonomic
    driven = check.hypotheses[:1]
    reason = f"for this actuation: the inputs drive {inputs.driven} of {inputs.dof} quasi-velocities"
    if check.name == "accessible" and check.verdict:
        verdict = None if reached is None else reached == states
        if verdict is not None:
            reason += (
                f"; brackets with the drift span {reached} of {states} dimensions, by numbers, at the "
                "default parameters"
            )
        return replace(check, verdict=verdict, reason=reason, hypotheses=driven, reference=ACCESSIBILITY)
    if check.verdict is False and check.name in ("accessible", "controllable", "asymptotically_stabilizable"):
        return replace(check, hypotheses=check.hypotheses[1:])
    if check.name in ("controllable", *LINEARIZABLE) and reached is not None and reached < states:
        return replace(
            check, verdict=False, reason="it is not accessible", hypotheses=driven, reference=ACCESSIBILITY
        )
    if check.name == "input_state_linearizable" and check.where == SPACE and Delta.holonomic:
        return replace(
            check, verdict=False, reason="it is not accessible", hypotheses=driven, reference=ACCESSIBILITY
        )
    if check.name in LINEARIZABLE and inputs.linearizable is not None:
        verdict, why = inputs.linearizable
        if check.name == "dynamic_feedback_linearizable" and verdict:
            return replace(
                check,
                verdict=True,
                reason="static feedback is sufficient",
                hypotheses=driven,
                reference=JAKUBCZYK,
            )
        if check.name == "dynamic_feedback_linearizable" and inputs.driven == 1:
            why = f"{why}; with one input, dynamic feedback linearizes what static feedback does"
            return replace(
                check, verdict=False, reason=f"{reason}; {why}", hypotheses=driven, reference=ONE_IS_STATIC
            )
        numbers = "at random states, at the default parameters"
        if check.name == "input_state_linearizable":
            return replace(
                check,
                verdict=verdict,
                reason=f"{reason}; {why}, {numbers}",
                hypotheses=driven,
                reference=JAKUBCZYK,
            )
    if check.name == "lagrange_stable" and inputs.momentum:
        moved = ", ".join(inputs.momentum)
        why = (
            f"the momentum of a common displacement of {moved} is constant, and where it is not 0 a "
            "function of q grows with it"
        )
        return replace(check, verdict=False, reason=f"{reason}; {why}", hypotheses=driven, reference=NOETHER)
    if check.name == "controllable" and inputs.at_rest is not None:
        return replace(check, verdict=inputs.at_rest, hypotheses=driven, **_at_rest(inputs.at_rest, reason))
    return replace(
        check,
        verdict=None,
        reason=reason,
        hypotheses=driven,
        reference="the theorems used here apply to (13)",
    )


def _at_rest(verdict: bool, reason: str) -> dict[str, str]:
    """Return reason and reference of a verdict about small-time local controllability at rest."""
    numbers = "at random configurations, at the default parameters"
    if verdict:
        found = (
            "the inputs and their symmetric products span all velocities, and no bad product is "
            f"outside, {numbers}"
        )
        return {"reason": f"{reason}; {found}", "reference": SYMMETRIC}
    found = f"[g, [f, g]] of the only input g is outside the span of g, [f, g], [f, [f, g]], ..., {numbers}"
    return {"reason": f"{reason}; {found}", "reference": ONE_INPUT}


def _generic(Delta: Distribution) -> Hypothesis:
    return Hypothesis(
        f"dim Delta* = {Delta.growth[-1]} about the configuration: at generic ones, proved exactly", True
    )


def _accessible(Delta: Distribution, where: str) -> Check:
    n, m, k = Delta.functions.n, Delta.m, Delta.holonomic
    whole = where == LEAF or k == 0
    reached = 2 * n - m - k
    reason = (
        f"Delta* and the directions of the quasi-velocities span all {reached} dimensions"
        if whole
        else f"{k} function{'s' if k > 1 else ''} of q cannot change: {reached} of {2 * n - m} dimensions "
        "are reached"
    )
    return Check("accessible", "strongly accessible", where, whole, reason, (_generic(Delta),), "Theorem 1")


def _controllable(Delta: Distribution, where: str) -> Check:
    whole = where == LEAF or Delta.holonomic == 0
    reason = (
        "qdot = S nu satisfies Chow's condition, and adding integrators to nu makes no bad bracket at nu = 0"
        if whole
        else "it is not accessible"
    )
    hypotheses = (
        _generic(Delta),
        Hypothesis("S is analytic where it is defined", True),
        Hypothesis("the state is at rest, nu = 0", None),
        Hypothesis("u may take all values about 0", None),
    )
    return Check(
        "controllable",
        "small-time locally controllable at equilibria",
        where,
        whole,
        reason,
        hypotheses,
        f"Theorem 1; {SUSSMANN}",
    )


def _lagrange(Delta: Distribution, where: str) -> Check:
    bounded = _bounded(Delta)
    reason = (
        "u = -kappa nu, kappa > 0, makes nu decay, and q stays within |nu(0)| sup|S| / kappa of its start"
    )
    if not bounded:
        reason += ", for starts slow enough to stay where S is regular"
    hypotheses = (
        Hypothesis("S is bounded for all q: no coordinate but in sines and cosines, no pole", bounded),
    )
    return Check(
        "lagrange_stable", "can be made Lagrange stable", where, True, reason, hypotheses, "Theorem 2"
    )


def _asymptotic(Delta: Distribution, where: str) -> Check:
    n, inputs = Delta.functions.n, len(Delta.fields)
    dimension = n - Delta.holonomic if where == LEAF else n
    possible = inputs == dimension
    if possible:
        double = f"{inputs} double integrator{'s' * (inputs > 1)}"
        reason = f"there are as many quasi-velocities as dimensions of q there, {inputs}: it is {double}"
    elif where == SPACE and Delta.holonomic:
        reason = (
            f"k = {Delta.holonomic} functions of q never change, and velocities have {inputs} of {n} "
            "directions (Brockett)"
        )
    else:
        reason = (
            f"about q the velocities have only {inputs} of {dimension} directions: Brockett's necessary "
            "condition fails"
        )
    hypotheses = (
        Hypothesis(f"S is smooth and of rank {inputs} at the equilibrium: generic, proved exactly", True),
        Hypothesis("the feedback is continuous, static and does not depend on time", None),
    )
    return Check(
        "asymptotically_stabilizable",
        "can be made asymptotically stable by smooth static state feedback",
        where,
        possible,
        reason,
        hypotheses,
        f"Theorem 2; {BROCKETT}",
    )


def _static(Delta: Distribution, where: str) -> Check:
    k, m = Delta.holonomic, Delta.m
    involutive = linearization_steps(Delta)[1].involutive
    accessible = where == LEAF or k == 0
    if not involutive:
        reason = "D_2 is not involutive, it contains Delta" + (
            "" if accessible else f"; nor is it accessible, k = {k}"
        )
    elif not accessible:
        reason = (
            f"D_1, D_2, ... are involutive, but never fill R^(2n-m): k = {k} functions of q cannot change"
        )
    else:
        reason = "D_1 and D_2 are involutive, and D_2 is the whole space: double integrators"
    hypotheses = (
        Hypothesis("strongly accessible", accessible),
        Hypothesis("D_1, D_2, ... are involutive", involutive),
        Hypothesis(f"at least one constraint is nonholonomic: {m - k} of {m}", m > k),
    )
    return Check(
        "input_state_linearizable",
        "input-state linearizable by static feedback",
        where,
        involutive and accessible,
        reason,
        hypotheses,
        f"Theorem 3; {ISIDORI}",
    )


def linearizable_dynamically(Delta: Distribution) -> Check:
    """Return what dynamic feedback can achieve, on the leaf if k > 0: only where a theorem applies."""
    inputs, states = len(Delta.fields), Delta.functions.n - Delta.holonomic
    where = LEAF if Delta.holonomic else SPACE
    gap = states - inputs
    hypotheses: tuple[Hypothesis, ...] = (
        Hypothesis("the motion avoids singular states, including rest", None),
    )
    if gap == 0:
        verdict, reason, reference = True, "static feedback is sufficient", "Theorem 3"
    elif inputs == 2:
        flag = Delta.derived.growth
        verdict = flag == tuple(range(2, states + 1))
        listed = ", ".join(map(str, flag))
        hypotheses = (Hypothesis(f"the derived flag grows one by one: ({listed})", verdict), *hypotheses)
        says = (
            "so it is flat: dynamic feedback linearizes it"
            if verdict
            else "so it is not flat: no endogenous dynamic feedback linearizes it"
        )
        reason, reference = f"two inputs and a derived flag of dimensions ({listed}), {says}", TWO_INPUTS
    elif gap == 1:
        verdict, reference = True, PFAFF
        reason = "one nonholonomic constraint: it is flat, dynamic feedback linearizes it"
    elif gap == 2:
        verdict, reference = True, CODIMENSION_TWO
        reason = f"{inputs} inputs, two states more and accessible: it is flat"
    else:
        verdict, reference = None, "no general test is known"
        reason = f"{inputs} inputs and {states} states: none of the theorems used here applies"
    return Check(
        "dynamic_feedback_linearizable",
        "linearizable by dynamic feedback",
        where,
        verdict,
        reason,
        hypotheses,
        reference,
    )


def _bounded(Delta: Distribution) -> bool:
    """Return whether S is certainly bounded: it has no pole and no coordinate outside sines and cosines."""
    functions = Delta.functions
    sizes = {k for angle in functions.angles for k in (angle.cosine, angle.sine)}
    allowed = sizes | set(range(functions.constants))
    ratios = [functions.lowest(*functions.ratio(entry)) for entry in Delta.S]
    return all(
        functions.never_zero(below)
        and functions.is_constant(below)
        and all(k in allowed for powers in above for k, power in enumerate(powers) if power)
        for above, below in ratios
    )
