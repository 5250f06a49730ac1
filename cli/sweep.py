"""`noslip sweep`: estimates the probability of failure with random masses, geometry, sensors,
delays and initial states."""

import argparse
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from ..readers.errors import BadInput
from ..readers.files import check_ending, check_folder, check_targets, write_folder
from ..readers.progress import Progress
from .commands import refuse_given, show

if TYPE_CHECKING:
    from ..simulation.sweeping.study import Study

EXAMPLE = """examples:
  noslip sweep examples/specs/sweep.toml --samples 10000 -o sweep.parquet --figures build/sweep
  noslip sweep examples/specs/sweep.toml --samples 10000 -o sweep.parquet --indices 1024 --worst --json
  noslip simulate sweep.parquet --sample 17 -o run.csv --plot run.png
An interrupted sweep is resumed by the same command."""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip sweep`."""
    parser = subparsers.add_parser(
        "sweep",
        help="simulate many closed loops with random parameters",
        description="Simulate the closed loop of SPEC.toml many times with random numbers as specified in "
        "[sweep]: see docs/sweep.md.",
        epilog=EXAMPLE,
    )
    parser.add_argument(
        "spec",
        metavar="SPEC.toml",
        help="as for simulate, with [sweep] and [sweep.plant], [sweep.initial], ...",
    )
    parser.add_argument("--samples", metavar="N", type=int, required=True, help="number of samples")
    parser.add_argument(
        "-o", "--output", metavar="OUT.parquet", required=True, help="output file, one row per sample"
    )
    parser.add_argument("--jobs", metavar="J", type=int, help="number of threads (default: number of cores)")
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="run on a Dask cluster, for example tcp://10.0.0.1:8786"
    )
    parser.add_argument(
        "--indices", metavar="N", type=int, help="also compute Sobol indices from N points, a power of 2"
    )
    parser.add_argument("--worst", action="store_true", help="also search for the worst combination")
    parser.add_argument("--verify", metavar="N", type=int, help="repeat N samples with simulate and compare")
    parser.add_argument(
        "--figures", metavar="DIR", help="plot errors over time, errors by parameter, and singular starts"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip sweep`. Return 0, or 1 if --verify finds a difference. Raises BadInput,
    ModelError, OSError."""
    from ..simulation.specification.spec import read_text
    from ..simulation.sweeping.results.report import SweepReport
    from ..simulation.sweeping.results.statistics import check_indices, indices, summarize
    from ..simulation.sweeping.results.verify import check_verify, verify
    from ..simulation.sweeping.results.worst import find_worst
    from ..simulation.sweeping.store import is_finished
    from ..simulation.sweeping.study import study_of

    _check(args)
    jobs, output = args.jobs or os.cpu_count() or 1, Path(args.output)
    text = read_text(args.spec)
    study = study_of(text, args.spec, args.samples)
    if not study.plan.names:
        refuse_given(
            args, ("worst", "indices"), "requires numbers that vary: nothing varies except the noise"
        )
    if args.indices is not None:
        check_indices(study, args.indices)
    if args.verify is not None:
        check_verify(study)
    if is_finished(output, study):
        print(f"{output} exists already and is complete", file=sys.stderr)
        _clear(study, output)
    else:
        _run_samples(study, output, jobs, args.scheduler)
    summary = summarize(output, study)
    with Progress() as progress:
        sensitivity = indices(study, args.indices, jobs, progress) if args.indices is not None else None
        worst = find_worst(study, summary.worst, jobs, progress) if args.worst else None
        verified = verify(output, args.verify, jobs, progress) if args.verify is not None else None
        report = SweepReport(args.spec, args.output, study, summary, sensitivity, worst, verified)
        drawn = _draw(report, jobs, args.figures, progress) if args.figures else []
    files = [str(output), *drawn]
    show(
        args, lambda: f"{report.text()}\n\n  {', '.join(files)}", lambda: {**report.as_json(), "files": files}
    )
    return 1 if verified and not verified.holds else 0


def _check(args: argparse.Namespace) -> None:
    """Raise BadInput for errors that would otherwise occur only after a long run."""
    from ..readers.reading import whole  # slow to import

    for option in ("samples", "jobs", "indices", "verify"):
        if (value := getattr(args, option)) is not None:
            whole(1)(value, f"--{option}")
    if args.output == "-":
        raise BadInput("-o -: a sweep is resumed from its file; give a file name")
    check_targets([args.output], inputs=[args.spec])
    check_ending(args.output, [".parquet"], "the results of a sweep")
    if args.figures:
        check_folder(args.figures)


def _run_samples(study: "Study", output: Path, jobs: int, scheduler: str | None) -> None:
    from ..simulation.sweeping.runner import TableRunner, engine_of, run_parts
    from ..simulation.sweeping.store import Parts, merge

    engine: TableRunner
    if scheduler:
        from ..simulation.sweeping.cluster import Cluster

        engine = Cluster(scheduler, study)
    else:
        engine = engine_of(study, jobs)
    parts = Parts(output, study)
    try:
        with parts.held(), Progress() as progress:
            run_parts(parts, engine, progress)
            merge(parts)
            parts.remove()
    finally:
        engine.close()


def _clear(study: "Study", output: Path) -> None:
    """Remove the temporary folder that a killed run may have left;
    folders of other processes are not touched."""
    from ..simulation.sweeping.store import Parts

    parts = Parts(output, study)
    if parts.folder.is_dir():
        with suppress(BadInput, OSError), parts.held():
            parts.remove()


def _draw(report, jobs: int, folder: str, progress: Progress) -> list[str]:
    from ..simulation.sweeping.results.figures import figures_of

    figures = figures_of(report, jobs, progress)
    write_folder(Path(folder), figures)
    return [str(Path(folder) / name) for name in figures if name.endswith(".png")]
