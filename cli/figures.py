"""`noslip figures`: the paper's figures and further ones, run on the generated C, with their claims checked by number."""

import argparse
import json
import os
import sys
from pathlib import Path

from ..readers.errors import BadInput
from ..readers.files import check_folder, write_folder

EXAMPLE = """example:
  noslip figures -o build/figures
  noslip figures --only 6 8a sampled -o build/figures"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "figures",
        help="draw the paper's figures from the generated C and check what they claim",
        description="Run the paper's experiments and some more on the generated C, draw them and check their claims by number. "
        "Writes DIR/report.html, which needs no other file, and each figure as PNG and SVG. Exit 1 when a claim that should "
        "hold does not.",
        epilog=EXAMPLE,
    )
    parser.add_argument("-o", dest="out", metavar="DIR", default="figures", help="where they go (default: figures)")
    parser.add_argument("--only", nargs="+", metavar="NAME", default=[], help="some of them: 1, 6, 8a, sampled, ...")
    parser.add_argument(
        "--jobs", type=int, metavar="N", default=os.cpu_count() or 1, help="processes (default: as many as cores)"
    )
    parser.add_argument("--json", action="store_true", help="print the claims as JSON")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """The command: 0, or 1 when a claim fails. Raises BadInput, ModelError, OSError."""
    from ..evidence.catalogue import chosen  # slow to import
    from ..evidence.production import Made, produce
    from ..evidence.report import as_json, report, summary

    if args.jobs < 1:
        raise BadInput(f"--jobs {args.jobs}: at least one process is needed")
    figures = chosen(args.only)
    done: list[Made] = []

    def show(made: Made) -> None:
        done.append(made)
        print(f"[{len(done):2}/{len(figures)}] figure {made.figure.name}: {summary([made])}", file=sys.stderr, flush=True)

    check_folder(args.out)
    made = produce(figures, args.jobs, show)
    drawn = {f"figure_{each.figure.name}.{kind}": picture for each in made for kind, picture in each.pictures.items()}
    write_folder(Path(args.out), drawn | {"report.html": report(made)})
    if args.json:
        print(json.dumps(as_json(made), indent=1, ensure_ascii=False))
    where = os.path.join(args.out, "report.html")
    print(
        f"{where}: {len(made)} figure{'s' if len(made) > 1 else ''}; {summary(made)}",
        file=sys.stderr if args.json else sys.stdout,
    )
    return 0 if all(claim.as_expected for each in made for claim in each.claims) else 1
