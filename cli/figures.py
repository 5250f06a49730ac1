"""`noslip figures`: runs the experiments of the paper and further ones on the generated C and checks their
claims numerically."""

import argparse
import os
import sys
from pathlib import Path

from ..readers.errors import installing
from ..readers.files import check_folder, write_folder
from ..readers.progress import Progress
from .commands import show

EXAMPLE = """example:
  noslip figures -o build/figures
  noslip figures --only 6 8a sampled -o build/figures"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip figures`."""
    parser = subparsers.add_parser(
        "figures",
        help="reproduce the paper's figures from the generated C and check their claims",
        description="Run the paper's experiments and further ones on the generated C, draw them and check "
        "their claims numerically. Writes a self-contained DIR/report.html, and each figure as "
        "PNG and SVG with its data as CSV. The exit code is 1 if a claim that should hold does "
        "not.",
        epilog=EXAMPLE,
    )
    parser.add_argument(
        "-o", dest="out", metavar="DIR", default="figures", help="output folder (default: figures)"
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--only",
        nargs="+",
        metavar="NAME",
        default=[],
        help="draw these figures only: 1, 6, 8a, sampled, ...",
    )
    which.add_argument(
        "--all",
        action="store_true",
        help="also a figure of each other robot, and those of the floor in a physics engine, which take "
        "minutes",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        metavar="N",
        default=os.cpu_count() or 1,
        help="number of processes (default: number of cores)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip figures`. Return 0, or 1 if a claim fails. Raises BadInput, ModelError, OSError."""
    from ..examples.evidence.catalogue import chosen, left_out  # slow to import
    from ..examples.evidence.production import Made, produce
    from ..examples.evidence.report import as_json, by_whom, report, summary
    from ..readers.reading import whole

    whole(1)(args.jobs, "--jobs")
    figures = chosen(args.only, args.all)
    if args.all and (missing := left_out()):
        print(
            f"left out, for want of a physics engine: {', '.join(missing)}; {installing('physics')}",
            file=sys.stderr,
        )
    done: list[Made] = []

    def tell(latest: Made) -> None:
        done.append(latest)
        progress.clear()
        print(
            f"[{len(done):2}/{len(figures)}] figure {latest.figure.name}: {summary([latest])}",
            file=sys.stderr,
            flush=True,
        )
        progress(len(done), len(figures), "figures")

    check_folder(args.out)
    with Progress() as progress:
        progress(0, len(figures), "figures")
        produced = produce(figures, args.jobs, tell)
    drawn = {
        f"figure_{each.figure.name}.{kind}": picture
        for each in produced
        for kind, picture in each.pictures.items()
    }
    write_folder(Path(args.out), drawn | {"report.html": report(produced)})
    where = os.path.join(args.out, "report.html")
    claims = "; ".join(by_whom(produced))
    show(
        args,
        lambda: f"{where}: {len(produced)} figure{'s' if len(produced) > 1 else ''}; {claims}",
        lambda: as_json(produced),
    )
    return 0 if all(claim.as_expected for each in produced for claim in each.claims) else 1
