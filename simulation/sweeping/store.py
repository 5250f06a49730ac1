"""Results of a sweep: finished parts in a folder beside the output, and at the end one Parquet file.

The file depends on the SPEC and the number of samples alone: rows in order, a row group for each part, no
dates.
"""

import fcntl
import hashlib
import json
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from ...readers.errors import BadInput, installing, naming
from ...readers.files import create, replacing
from .inputs import SEED
from .study import Study

try:
    import pyarrow as pa
    import pyarrow.parquet as pq
except ImportError as error:
    raise BadInput(
        f"a sweep is kept in a Parquet file, which needs pyarrow; {installing('sweep')}"
    ) from error

# Of samples in a part; of parts, so that all cores stay busy until the end
LARGEST, SMALLEST, FEWEST = 4096, 32, 64
SPEC, IDENTITY = b"noslip.spec", b"noslip.sweep"  # in the file's metadata
MANIFEST = "sweep.json"
# Files in the folder of the parts, also temporary ones
OWN = re.compile(r"sweep\.json|\d{7}|\..+\.[0-9a-f]{12}\.part")
DIGEST = hashlib.sha256().digest_size


def part_size(samples: int) -> int:
    """Return the number of samples in each part except the last."""
    return int(np.clip(-(-samples // FEWEST), SMALLEST, LARGEST))


class Parts:
    """The finished parts of a sweep, in OUT.parts: for each part the table, its outcomes (raw doubles), and
    their digest.

    A manifest identifies the sweep of the folder. Other files in it are neither read nor removed.
    """

    def __init__(self, output: Path, study: Study):
        self.output = Path(os.path.realpath(output)) if output.is_symlink() else output
        self.folder, self.study = self.output.with_name(self.output.name + ".parts"), study
        self.size = part_size(study.samples)
        self.count = -(-study.samples // self.size)
        self.width = len(study.batch.inputs) + len(study.batch.outcomes)

    def range(self, part: int) -> tuple[int, int]:
        """Return the first sample of a part and the number of its samples."""
        first = part * self.size
        return first, min(self.size, self.study.samples - first)

    @contextmanager
    def held(self) -> Iterator[None]:
        """Create the folder if necessary and lock it. Raises BadInput if it belongs to another sweep or is in
        use."""
        try:
            if self.folder.is_symlink():
                raise BadInput(f"{self.folder} is a link; remove it or change -o")
            self.folder.mkdir(exist_ok=True)
            handle = os.open(self.folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.folder)) from error
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise BadInput(
                    f"{self.folder} is in use by another noslip sweep; wait for it or change -o"
                ) from error
            self._claim()
            yield
        finally:
            os.close(handle)

    def missing(self) -> list[int]:
        """Return the parts that are missing or damaged."""
        return [part for part in range(self.count) if self._data(part) is None]

    def write(self, part: int, table: np.ndarray, outcomes: np.ndarray) -> None:
        """Write a part atomically and durably. Raises OSError with its name."""
        data = np.hstack([table, outcomes]).tobytes()
        with replacing(self._file(part)) as new:
            create(new, data + self._digest(part, data))

    def read(self, part: int) -> tuple[np.ndarray, np.ndarray]:
        """Return table and outcomes of a part. Raises BadInput if it is damaged."""
        data = self._data(part)
        if data is None:
            raise BadInput(
                f"{self._file(part)} was damaged while the sweep ran; the same command computes it again"
            )
        table, outcomes = np.split(
            np.frombuffer(data).reshape(-1, self.width), [len(self.study.batch.inputs)], axis=1
        )
        return table, outcomes

    def remove(self) -> None:
        """Remove the files of the sweep, the manifest last, and the folder unless it contains other files."""
        own = [path for path in self.folder.iterdir() if OWN.fullmatch(path.name)]
        for path in sorted(own, key=lambda path: path.name == MANIFEST):
            with suppress(IsADirectoryError):
                path.unlink()
        try:
            self.folder.rmdir()
        except OSError:
            print(f"{self.folder} has files that are not the sweep's; they are left", file=sys.stderr)

    def _claim(self) -> None:
        """Raise BadInput unless the folder belongs to this sweep; an empty folder receives its manifest."""
        manifest, identity = self.folder / MANIFEST, self.study.identity
        if not os.path.lexists(manifest):
            if any(
                not path.name.endswith(".part") or not OWN.fullmatch(path.name)
                for path in self.folder.iterdir()
            ):
                raise BadInput(f"{self.folder} exists and is not a sweep's; move it or change -o")
            with replacing(manifest) as new:
                create(new, (json.dumps(identity, indent=1) + "\n").encode())
        damaged = ValueError, TypeError, RecursionError
        with naming(f"{manifest} is damaged or not a sweep's", damaged, f"remove {self.folder} or change -o"):
            found = dict(json.loads(manifest.read_bytes()))
        if found != identity:
            raise BadInput(
                f"{self.folder} has parts of another sweep: {_difference(found, identity)}; remove it or "
                "change -o"
            )

    def _file(self, part: int) -> Path:
        return self.folder / f"{part:07d}"

    def _digest(self, part: int, data: bytes) -> bytes:
        """Return the digest of the numbers of a part, its index and its sweep."""
        return hashlib.sha256(json.dumps([self.study.identity, part]).encode() + data).digest()

    def _data(self, part: int) -> bytes | None:
        """Return the numbers of a part; None if it is missing or damaged."""
        with suppress(OSError):
            whole = self._file(part).read_bytes()
            data, digest = whole[:-DIGEST], whole[-DIGEST:]
            if len(data) == self.range(part)[1] * self.width * 8 and digest == self._digest(part, data):
                return data
        return None


def merge(parts: Parts) -> None:
    """Write all parts to the output, with one part in memory at a time. Raises OSError with its name."""
    schema = _schema(parts.study)
    options = {"compression": "zstd", "use_dictionary": ["status"], "write_page_checksum": True}
    with replacing(parts.output, parts.folder) as new, open(new, "xb") as file:
        with pq.ParquetWriter(file, schema, **options) as writer:
            for part in range(parts.count):
                columns = _columns(parts.study, parts.range(part)[0], *parts.read(part))
                writer.write_table(pa.table(columns, schema), row_group_size=parts.size)


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


@contextmanager
def _reading(file: Path | str) -> Iterator[None]:
    """Convert errors about a file within the block to BadInput."""
    try:
        yield
    except FileNotFoundError as error:
        raise BadInput(f"{file}: there is no such file") from error
    except (
        pa.ArrowException,
        OSError,
        KeyError,
        ValueError,
        TypeError,
        RecursionError,
        OverflowError,
    ) as error:
        raise BadInput(f"{file} is not a finished noslip sweep, or is damaged") from error


def open_sweep(file: Path | str) -> tuple[pq.ParquetFile, str, dict]:
    """Return a finished sweep, the text of its SPEC and its identity. Raises BadInput for any other file."""
    with _reading(file):
        found = pq.ParquetFile(file, page_checksum_verification=True)
        metadata = found.schema_arrow.metadata or {}
        text, identity = metadata[SPEC].decode(), dict(json.loads(metadata[IDENTITY]))
        same_text = identity["spec_sha256"] == hashlib.sha256(text.encode()).hexdigest()
        size = part_size(identity["samples"])
        groups = [found.metadata.row_group(k).num_rows for k in range(found.num_row_groups)]
        if not same_text or sum(groups) != identity["samples"] or any(rows != size for rows in groups[:-1]):
            raise ValueError(file)
        return found, text, identity


def is_finished(output: Path, study: Study) -> bool:
    """Whether the file already has the complete results of this sweep. Raises BadInput if it is another
    file."""
    if not output.exists():
        return False
    with naming("", remedy="remove it or change -o"):
        found, _, identity = open_sweep(output)
    if identity != study.identity:
        raise BadInput(
            f"{output} is another sweep: {_difference(identity, study.identity)}; remove it or change -o"
        )
    with _reading(output):
        if not found.schema_arrow.equals(_schema(study), check_metadata=True):
            raise ValueError(output)
        for group in range(found.num_row_groups):
            found.read_row_group(group).validate(full=True)
    return True


def sample_of(file: Path | str, sample: int) -> tuple[str, dict[str, float], dict[str, Any]]:
    """Return, for one sample of a finished sweep, the text of the SPEC, the varied numbers and the outcomes,
    by name.

    Raises BadInput if there is no such sample.
    """
    found, text, identity = open_sweep(file)
    if not 0 <= sample < identity["samples"]:
        raise BadInput(f"{file}: there is no sample {sample}; they are 0 to {identity['samples'] - 1}")
    group, row = divmod(sample, part_size(identity["samples"]))
    with _reading(file):
        values = found.read_row_group(group).slice(row, 1).to_pylist()[0]
        first = list(values).index("status")
    return text, dict(list(values.items())[1:first]), dict(list(values.items())[first:])


def _difference(found: dict, identity: dict) -> str:
    """Describe the difference between two identities."""
    if found.get("spec_sha256") != identity["spec_sha256"]:
        return "its SPEC is not this one"
    found = {"format": 1, **found}  # the first did not say so
    return ", ".join(
        f"{key} {found.get(key)}, not {value}" for key, value in identity.items() if found.get(key) != value
    )
