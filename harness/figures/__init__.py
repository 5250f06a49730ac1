"""`noslip figures`: the paper's figures and further ones, run on the generated C, with their claims checked by number."""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import BadInput
from ..files import remove, unfinished

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
        formatter_class=argparse.RawDescriptionHelpFormatter,
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
    from .catalogue import chosen  # slow to import
    from .production import Made, produce
    from .report import as_json, report, summary

    if args.jobs < 1:
        raise BadInput(f"--jobs {args.jobs}: at least one process is needed")
    figures = chosen(args.only)
    done: list[Made] = []

    def show(made: Made) -> None:
        done.append(made)
        print(f"[{len(done):2}/{len(figures)}] figure {made.figure.name}: {summary([made])}", file=sys.stderr, flush=True)

    with _filled(args.out) as folder:
        made = produce(figures, args.jobs, show)
        for each in made:
            for kind, picture in each.pictures.items():
                (folder / f"figure_{each.figure.name}.{kind}").write_bytes(picture)
        (folder / "report.html").write_text(report(made), encoding="utf-8")
    if args.json:
        print(json.dumps(as_json(made), indent=1, ensure_ascii=False))
    where = os.path.join(args.out, "report.html")
    print(
        f"{where}: {len(made)} figure{'s' if len(made) > 1 else ''}; {summary(made)}",
        file=sys.stderr if args.json else sys.stdout,
    )
    return 0 if all(claim.as_expected for each in made for claim in each.claims) else 1


@contextmanager
def _filled(name: str) -> Iterator[Path]:
    """A folder whose files move to the folder `name` in the end; when something is wrong, nothing is left.

    Raises BadInput or OSError at once when nothing can be written there.
    """
    target = Path(os.path.realpath(name))
    if os.path.lexists(target) and not target.is_dir():
        raise BadInput(f"{name} is there and is no folder; give a folder")
    new = [folder for folder in (target, *target.parents) if not os.path.lexists(folder)][-1:]  # the outermost
    unfinished.update(new)
    try:
        target.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target, prefix=".noslip-") as work:
            unfinished.add(Path(work))
            yield Path(work)
            for path in sorted(Path(work).iterdir()):
                os.replace(path, target / path.name)
        unfinished.discard(Path(work))
    except BaseException as error:
        remove(new)
        if isinstance(error, OSError) and error.errno is not None:
            raise OSError(error.errno, error.strerror, name) from error
        raise
    finally:
        unfinished.difference_update(new)
