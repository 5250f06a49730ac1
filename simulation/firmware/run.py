"""A run of the firmware of a SPEC's vehicle on this host: its C, and the robot of the C that tests it, between two ticks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cffi
import numpy as np

from ...codegen.files import has_follower, robot_files
from ...codegen.loop.stages import broken
from ...codegen.printing.scalar import FLOAT
from ...codegen.project.vehicle import VehicleNumbers, columns, places, vehicle_files
from ...codegen.targets import BOARDS
from ...model.law import ControlLaw
from ...readers.files import write_folder
from ..controllers.runtime import InC, declarations, load
from ..loop import Loop
from ..noise import source
from ..run import Run
from ..specification.spec import Spec
from .numbers import EXPORT, numbers_of

HEADERS = ("console.h", "decimal.h")  # of the project, besides those of the vehicle


def runs_as_firmware(spec: Spec, law: ControlLaw) -> bool:
    """Return whether a SPEC is run by the C in float that `noslip export --firmware` writes for its vehicle."""
    return spec.simulation.backend == "cf" and not broken(spec, EXPORT) and has_follower(law)


def run_of_firmware(spec: Spec, loop: Loop, progress: Callable[[float], None] | None = None) -> Run:
    """Return the run of a SPEC that `runs_as_firmware`; `progress` receives the time reached. Its rows are those that the test
    of the exported project prints.

    Raises BadInput as `numbers_of`.
    """
    law, vehicle = loop.law, numbers_of(spec, loop)
    drive = DriveInC(law, vehicle)
    rows = drive.rows(progress)
    status = np.array([drive.status(number) for number in rows["status"].tolist()])
    count, contacts = len(rows), [each.name for each in law.system.mechanism.standing]
    none, n = np.empty((count, 0)), len(law.system.mechanism.coordinates)
    piece = rows["piece"].astype(int)
    return Run(
        spec=spec,
        law=law,
        plant=loop.plant,
        t=rows["t"],
        q=rows["x"][:, :n],
        nu=rows["x"][:, n:],
        tau=rows["tau"],
        y=rows["y"],
        y_d=rows["desired"],
        status=status,
        forces=rows["force"],
        seen=rows["seen"],
        piece=piece,
        config=np.array(places(law, vehicle))[piece],
        integral=rows["integral"][:, list(vehicle.integrals)],
        extension=none,
        integral_rows=loop.integral.rows,
        command=rows["command"] if vehicle.drives else none,
        noticed=rows["believed"][:, None] if "believed_mu" in drive.columns else none,
        learned=none,
        use=dict(zip(contacts, rows["use"].T, strict=True)) if vehicle.floor else {},
        warnings=loop.warnings,
    )


class DriveInC(InC):
    """The drive of a vehicle along its path, compiled; `columns` are those that it prints."""

    def __init__(self, law: ControlLaw, vehicle: VehicleNumbers):
        own = vehicle_files(law, FLOAT, vehicle)
        files = {Path(name).name: text for name, text in own.items()}
        files |= source() if vehicle.noise else {}
        files |= {name: (BOARDS.parent / "selftest" / name).read_text(encoding="utf-8") for name in HEADERS}
        made = robot_files(law.system, [law], (FLOAT.real,))
        files |= {name: text for name, text in made.items() if name.endswith((".c", ".h")) and "_telemetry" not in name}
        self.ffi = cffi.FFI()
        with TemporaryDirectory() as folder:
            write_folder(Path(folder), {"drive.h": files["drive.h"]})
            self.ffi.cdef("const char *noslip_status_name(int status);\n" + declarations("drive.h", Path(folder)))
        self.columns, self.lib = columns(law, vehicle), load(self.ffi, files)

    def rows(self, progress: Callable[[float], None] | None = None) -> np.ndarray:
        """Drive; return the rows, with the fields of `drive_row`."""
        size, taken = self.ffi.sizeof("drive_row"), bytearray()

        @self.ffi.callback("void(const drive_row *, void *)")
        def take(row: Any, _: object) -> None:
            taken.extend(self.ffi.buffer(row, size))
            if progress:
                progress(row.t)

        self.lib.drive(take, self.ffi.NULL)
        return np.frombuffer(bytes(taken), self._type())

    def _type(self) -> np.dtype:
        """Return the type of a row in NumPy."""
        fields = [(name, field, field.type) for name, field in self.ffi.typeof("drive_row").fields]
        sizes = [(kind.item.cname, (kind.length,)) if kind.kind == "array" else (kind.cname, ()) for _, _, kind in fields]
        layout: Any = {
            "names": [name for name, _, _ in fields],
            "formats": [(float if real == "double" else np.int32, shape) for real, shape in sizes],
            "offsets": [field.offset for _, field, _ in fields],
            "itemsize": self.ffi.sizeof("drive_row"),
        }
        return np.dtype(layout)
