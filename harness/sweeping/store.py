"""Where a sweep goes: finished parts in a folder beside the output, at the end all of it in one Parquet file.

The file depends on the SPEC and the number of samples alone: rows in order, a row group for each part, no dates.
"""

import fcntl
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ..errors import BadInput
from ..files import unfinished, write_whole
from .inputs import SEED
from .study import Study

LARGEST, SMALLEST, FEWEST = 4096, 32, 64  # samples in a part; parts, so that all cores have some until the end
SPEC, IDENTITY = b"noslip.spec", b"noslip.sweep"  # in the file's metadata
MANIFEST = "sweep.json"


def part_size(samples: int) -> int:
    """Samples in each part but the last."""
    return int(np.clip(-(-samples // FEWEST), SMALLEST, LARGEST))


class Parts:
    """The parts of a sweep that are finished, in OUT.parts: for each the table and its outcomes, raw doubles."""

    def __init__(self, output: Path, study: Study):
        self.folder, self.study = output.with_name(output.name + ".parts"), study
        self.size = part_size(study.samples)
        self.count = -(-study.samples // self.size)
        self.width = len(study.batch.inputs) + len(study.batch.outcomes)

    def range(self, part: int) -> tuple[int, int]:
        """First sample of a part, and how many it has."""
        first = part * self.size
        return first, min(self.size, self.study.samples - first)

    @contextmanager
    def held(self) -> Iterator[None]:
        """The folder, made if need be, for this process alone. Raises BadInput where it is another sweep's or in use."""
        manifest, wanted = self.folder / MANIFEST, self.study.identity
        try:
            self.folder.mkdir(exist_ok=True)
            handle = os.open(self.folder, os.O_RDONLY)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.folder)) from error
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise BadInput(f"{self.folder} is in use by another noslip sweep; wait for it or change -o") from error
            if not manifest.exists():
                write_whole(manifest, json.dumps(wanted, indent=1) + "\n", lasting=True)
            found = json.loads(manifest.read_bytes())
            if found != wanted:
                raise BadInput(f"{self.folder} has parts of another sweep: {_difference(found, wanted)}; remove it or change -o")
            yield
        finally:
            os.close(handle)

    def missing(self) -> list[int]:
        """Parts that are not there or not whole."""
        return [part for part in range(self.count) if not self._whole(part)]

    def write(self, part: int, table: np.ndarray, outcomes: np.ndarray) -> None:
        """Keep a part, whatever happens next. Raises OSError naming it."""
        write_whole(self._file(part), np.hstack([table, outcomes]).tobytes(), lasting=True)

    def read(self, part: int) -> tuple[np.ndarray, np.ndarray]:
        """Table and outcomes of a part."""
        rows = np.fromfile(self._file(part)).reshape(-1, self.width)
        return np.split(rows, [len(self.study.batch.inputs)], axis=1)

    def remove(self) -> None:
        """All of it."""
        shutil.rmtree(self.folder)

    def _file(self, part: int) -> Path:
        return self.folder / f"{part:07d}"

    def _whole(self, part: int) -> bool:
        with suppress(OSError):
            return self._file(part).stat().st_size == self.range(part)[1] * self.width * 8
        return False


def merge(parts: Parts, output: Path) -> None:
    """All parts into one file, a part in memory at a time. Raises OSError naming it."""
    unmerged = output.with_name(f".{output.name}.{os.getpid()}.part")
    unfinished.add(unmerged)
    try:
        schema = _schema(parts.study)
        with open(unmerged, "wb") as file:
            with pq.ParquetWriter(file, schema, compression="zstd", use_dictionary=["status"]) as writer:
                for part in range(parts.count):
                    columns = _columns(parts.study, parts.range(part)[0], *parts.read(part))
                    writer.write_table(pa.table(columns, schema), row_group_size=parts.size)
            file.flush()
            os.fsync(file.fileno())
        os.replace(unmerged, output)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(output)) from error
    finally:
        with suppress(OSError):
            unmerged.unlink()
        unfinished.discard(unmerged)


def _columns(study: Study, first: int, table: np.ndarray, outcomes: np.ndarray) -> dict[str, np.ndarray]:
    columns: dict[str, np.ndarray] = {"sample": np.arange(first, first + len(table))}
    columns |= study.plan.columns(table)
    if SEED in columns:
        columns[SEED] = columns[SEED].astype(np.int64)
    columns |= dict(zip(study.batch.outcomes, outcomes.T, strict=True))
    columns["status"] = np.array([study.batch.status(number) for number in columns["status"]])
    columns["failed"] = study.severity(table, outcomes) > 1
    return columns


def _schema(study: Study) -> pa.Schema:
    types = {"sample": pa.int64(), SEED: pa.int64(), "status": pa.string(), "failed": pa.bool_()}
    names = ["sample", *study.plan.columns(study.plan.table(0, 1)), *study.batch.outcomes, "failed"]
    metadata = {SPEC: study.text, IDENTITY: json.dumps(study.identity)}
    return pa.schema([(name, types.get(name, pa.float64())) for name in names], metadata)


def open_sweep(file: Path | str) -> tuple[pq.ParquetFile, str, dict]:
    """A finished sweep, the text of its SPEC and its identity. Raises BadInput for any other file."""
    try:
        found = pq.ParquetFile(file)
        metadata = found.schema_arrow.metadata or {}
        return found, metadata[SPEC].decode(), json.loads(metadata[IDENTITY])
    except FileNotFoundError as error:
        raise BadInput(f"{file}: there is no such file") from error
    except (pa.ArrowException, OSError, KeyError) as error:
        raise BadInput(f"{file} is not a finished noslip sweep") from error


def is_finished(output: Path, study: Study) -> bool:
    """Is this sweep there already? Raises BadInput where another file is in its place."""
    if not output.exists():
        return False
    try:
        found = open_sweep(output)[2]
    except BadInput as error:
        raise BadInput(f"{output} is there and is not a noslip sweep; remove it or change -o") from error
    if found != study.identity:
        raise BadInput(f"{output} is another sweep: {_difference(found, study.identity)}; remove it or change -o")
    return True


def sample_of(file: Path | str, sample: int) -> tuple[str, dict[str, float], dict[str, Any]]:
    """Of one sample of a finished sweep: the text of the SPEC, what varies by name, its outcomes by name.

    Raises BadInput for no such sample.
    """
    found, text, identity = open_sweep(file)
    if not 0 <= sample < identity["samples"]:
        raise BadInput(f"{file}: there is no sample {sample}; they are 0 to {identity['samples'] - 1}")
    group, row = divmod(sample, part_size(identity["samples"]))
    values = found.read_row_group(group).slice(row, 1).to_pylist()[0]
    first = list(values).index("status")
    return text, dict(list(values.items())[1:first]), dict(list(values.items())[first:])


def _difference(found: dict, wanted: dict) -> str:
    """What of two identities is not the same, in words."""
    if found.get("spec_sha256") != wanted["spec_sha256"]:
        return "its SPEC is not this one"
    return ", ".join(f"{key} {found.get(key)}, not {value}" for key, value in wanted.items() if found.get(key) != value)
