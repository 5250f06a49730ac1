"""The report of `noslip sweep`."""

import shlex
from dataclasses import dataclass
from typing import Any

from ....readers.printing import columns, plain
from ..study import STOPPED, Study
from .statistics import CONFIDENCE, ENDED, LEVELS, TIMES, Indices, SweepSummary
from .verify import TIME, Verified
from .worst import Worst

SAYS = 0.1  # smallest rank correlation and index that is printed


@dataclass(frozen=True, eq=False)
class SweepReport:
    """A finished sweep and the additional results requested."""

    spec: str  # file names
    output: str
    study: Study
    summary: SweepSummary
    indices: Indices | None = None
    worst: Worst | None = None
    verified: Verified | None = None

    def text(self) -> str:
        """Return the report as text."""
        blocks = [self._head(), self._sizes(), self._ranks()]
        blocks += [self._indices(self.indices)] if self.indices else []
        blocks += [self._worst_samples()] if self.summary.failed else []
        blocks += [self._worst(self.worst)] if self.worst else []
        blocks += [self._verified(self.verified)] if self.verified else []
        return "\n\n".join(block for block in blocks if block)

    def as_json(self) -> dict[str, Any]:
        """Return the report for JSON; values that are not finite are null."""
        summary, study = self.summary, self.study
        low, high = summary.interval
        made: dict[str, Any] = {
            "samples": summary.samples,
            "design": study.plan.sweep.design,
            "seed": study.plan.sweep.seed,
            "period": summary.ranges.get("simulation.period", study.spec.simulation.period),
            "vectors": study.batch.computed,
            "fails_when": str(study.criterion),
            "statuses": dict(summary.statuses),
            "failed": summary.failed,
            "failure_probability": summary.failed / summary.samples,
            "confidence": CONFIDENCE,
            "confidence_interval": [low, high],
            "quantiles": {
                name: dict(zip([*(f"{level:g}" for level in LEVELS), "max"], values, strict=True))
                for name, values in summary.sizes.items()
            },
            "rank_correlations": summary.ranks,
            "integration_error": summary.integration_error,
            "worst_samples": list(summary.worst),
        }
        if self.indices:
            keys = ("first", "total", "first_half_width", "total_half_width")
            made["sobol_indices"] = {
                outcome: {name: dict(zip(keys, four, strict=True)) for name, four in rows.items()}
                for outcome, rows in self.indices.values.items()
            }
        if self.worst:
            made["worst"] = {
                "severity": self.worst.severity,
                "status": self.worst.status,
                "set": study.changes(self.worst.row),
                "outcomes": self.worst.outcomes,
                "runs": self.worst.runs,
            }
        if self.verified:
            made["verified"] = {**vars(self.verified), "holds": self.verified.holds}
        return plain(made)

    def _head(self) -> str:
        study, summary = self.study, self.summary
        simulation, sweep = study.spec.simulation, study.plan.sweep
        period, duration = (
            _seconds(summary.ranges.get(name), getattr(simulation, name.split(".")[1])) for name in TIMES
        )
        held = f"called every {period}" + (
            " ([sweep] period; the SPEC is continuous)" if study.continuous else ""
        )
        low, high = summary.interval
        statuses = ", ".join(
            f"{count} {name}" for name, count in sorted(summary.statuses.items(), key=lambda item: -item[1])
        )
        design = {"random": "random", "sobol": "Sobol", "latin": "Latin hypercube"}[sweep.design]
        lines = [
            f"{study.spec.robot}, {study.batch.law.name}, backend {simulation.backend}, {held}, {duration}",
            f"{summary.samples} samples, {design}, seed {sweep.seed}, varying {len(study.plan.names)}: "
            f"{statuses}",
            f"  fails when {study.criterion}: {summary.failed} of {summary.samples}, "
            f"{_part(summary.failed / summary.samples)}; {CONFIDENCE:.0%} interval {_part(low)} to "
            f"{_part(high)} (Clopper-Pearson{self._caution()})",
            f"  largest integration error of runs to the end {summary.integration_error:.1e}; vectors: "
            f"{study.batch.computed}",
        ]
        return "\n".join(lines)

    def _caution(self) -> str:
        return "" if self.study.plan.sweep.design == "random" else ", as if the samples were independent"

    def _sizes(self) -> str:
        ended = sum(self.summary.statuses.get(name, 0) for name in ENDED)
        heads = [*(f"{level:.0%}" for level in LEVELS), "largest"]
        rows = [[name, *(f"{value:.3g}" for value in values)] for name, values in self.summary.sizes.items()]
        return "\n".join(columns([[f"size, of {ended} runs to the end (SI)", *heads], *rows]))

    def _ranks(self) -> str:
        """Return the rank correlations of each outcome, the largest first."""
        lines = []
        for outcome, ranks in self.summary.ranks.items():
            ranked = sorted(
                ((name, rho) for name, rho in ranks.items() if abs(rho) >= SAYS),
                key=lambda item: -abs(item[1]),
            )
            if ranked:
                lines.append(f"  {outcome}: " + ", ".join(f"{name} {rho:+.2f}" for name, rho in ranked))
        return (
            "\n".join([f"rank correlations of absolute values, if at least {SAYS:g}", *lines])
            if lines
            else ""
        )

    def _indices(self, indices: Indices) -> str:
        blocks = [
            f"Sobol indices, {indices.runs} runs; ± half the {CONFIDENCE:.0%} interval; the remainder to 1 "
            "is noise"
        ]
        for outcome, values in indices.values.items():
            ranked = sorted(values.items(), key=lambda item: -item[1][1])
            rows = [
                [name, f"{first:.2f} ± {a:.2f}", f"{total:.2f} ± {b:.2f}"]
                for name, (first, total, a, b) in ranked
            ]
            blocks += columns([[outcome, "first order", "total"], *rows])
        return "\n".join(blocks)

    def _worst_samples(self) -> str:
        lines = [
            f"  noslip simulate {shlex.quote(self.output)} --sample {k} -o run.csv --plot run.png"
            for k in self.summary.worst
        ]
        return "\n".join(["the worst samples", *lines])

    def _worst(self, worst: Worst) -> str:
        shown = ", ".join(f"{name} {worst.outcomes[name]:.4g}" for name in self.study.shown)
        how = (
            f"stops, {worst.status}, at {worst.outcomes['t_end']:.4g} s"
            if worst.severity >= STOPPED
            else shown
        )
        fails = "fails" if worst.severity > 1 else f"does not fail: at {worst.severity:.2g} of its limit"
        changes = " ".join(f"--set {shlex.quote(change)}" for change in self.study.changes(worst.row))
        head = (
            f"worst case found by differential evolution in {worst.runs} runs, without 0.1 % at each end, "
            f"{fails}: {how}"
        )
        return f"{head}\n  noslip simulate {shlex.quote(self.spec)} {changes} -o worst.csv --plot worst.png"

    def _verified(self, found: Verified) -> str:
        line = (
            f"{found.samples} samples repeated by noslip simulate: differences at the end up to "
            f"{found.largest:.1e} (sample {found.of}), tolerance {found.stated:.0e}; stops at the same time "
            f"to {TIME:.0e} s: {'holds' if found.holds else 'does not hold'}"
        )
        if found.otherwise:
            line += (
                f"\n  {len(found.otherwise)} ended differently: samples "
                f"{', '.join(map(str, found.otherwise[:10]))}"
            )
        return line


def _part(value: float) -> str:
    return f"{100 * value:.3g} %"


def _seconds(varied: tuple[float, float] | None, nominal: float) -> str:
    return f"{nominal:g} s" if varied is None else f"{varied[0]:.3g} to {varied[1]:.3g} s"
