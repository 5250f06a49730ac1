"""The C of a robot's control laws, returned only if it agrees with the model."""

from collections.abc import Mapping, Sequence

from ...codegen.files import robot_files
from ...codegen.printing.scalar import SCALARS
from ...model.law import ControlLaw
from ...model.reduction import ReducedSystem
from ...readers.errors import BadInput, Mismatch
from ...readers.progress import Reported, silent
from ...simulation.controllers.build import DoesNotCompile, check_links
from .shares import in_shares
from .verify import differences


def generate(
    system: ReducedSystem,
    laws: Sequence[ControlLaw],
    scalars: Sequence[str] = tuple(SCALARS),
    dynamics: bool = True,
    lanes: bool = False,
    scaled: Sequence[str] | None = None,
    adapted: Sequence[str] = (),
    progress: Reported = silent,
) -> dict[str, str]:
    """Return the C of control laws of a robot, compiled and compared with the model.

    `scalars` are the precisions to generate, "double" and "float"; `dynamics` adds the plant, nudot(q, nu,
    tau), `lanes` the batch laws, which have the bits of the laws; `scaled` adds the filter, and `adapted`
    what learns parameters. Returns the text of each file by its name, `manifest.json` included; the files
    also need those of runtime_c/ to compile. Units are SI. Every entry point is compared with the model at
    200 random states, and all files are compiled and linked; without a C compiler a warning on standard error
    says that nothing was compared. Raises Mismatch where the C differs from the model, or is rejected.
    """

    def share(k: int) -> None:
        """Derive and compare one law, or, after the last law, all that is not a law."""
        only = laws[k : k + 1]
        rest = (False, lanes, None, ()) if only else (dynamics, False, scaled, adapted)
        differences(system, only, robot_files(system, only, scalars, *rest), silent, rest[2])

    in_shares(share, len(laws) + (dynamics or scaled is not None), progress)
    files = robot_files(system, laws, scalars, dynamics, lanes, scaled, adapted)
    wrong = differences(system, laws, files, progress, scaled)
    if not wrong and (why := rejected({name: text for name, text in files.items() if "/" not in name})):
        wrong = [f"{system.mechanism.name}: {why}"]
    if wrong:
        raise Mismatch("\n".join(wrong))
    return files


def rejected(files: Mapping[str, str]) -> str:
    """Return why the compiler or the linker rejects the C among `files`; empty if it does not, or if there is
    no compiler, of which `differences` warns.
    """
    try:
        check_links(files)
    except DoesNotCompile as error:
        return str(error)
    except (BadInput, OSError):
        pass
    return ""
