"""Files written at once or not at all."""

import os
import shutil
import subprocess
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from .errors import BadInput

unfinished: set[Path] = set()  # temporary files and folders, to be removed by whoever stops the process
children: set[subprocess.Popen] = set()  # and programs that run for it, to be killed


def write_whole(path: str | Path, content: str | bytes, lasting: bool = False) -> None:
    """Write a file through a temporary one beside it; "-" is standard output. `lasting`: it is on the disk when this returns.

    Raises OSError naming the file.
    """
    if path == "-":
        print(content, end="")
        return
    data = content.encode() if isinstance(content, str) else content
    target = Path(os.path.realpath(path))
    part = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        if target.exists() and not target.is_file():  # a device or a pipe is written to, not replaced
            target.write_bytes(data)
            return
        unfinished.add(part)
        with open(part, "wb") as file:
            file.write(data)
            if lasting:
                file.flush()
                os.fsync(file.fileno())
        if target.exists():
            shutil.copymode(target, part)
        os.replace(part, target)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with suppress(OSError):
            part.unlink()
        unfinished.discard(part)


def write_folder(folder: Path, files: Mapping[str, str], stale: Collection[str] = ()) -> None:
    """Write files into a folder and folders in it, made if need be, all or none; `stale` are names in it to remove.

    A file that is right already is not touched. Raises OSError naming the folder.
    """
    new = not folder.exists()
    parts: dict[Path, Path] = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            path = folder / name
            if not path.is_file() or path.read_bytes() != text.encode():
                path.parent.mkdir(parents=True, exist_ok=True)
                parts[path] = path.with_name(f".{path.name}.{os.getpid()}.part")
                unfinished.add(parts[path])
                parts[path].write_text(text)
        for path, part in parts.items():
            os.replace(part, path)
        for name in stale:
            with suppress(FileNotFoundError):
                (folder / name).unlink()
    except OSError as error:
        remove(parts.values())
        if new:
            with suppress(OSError):
                folder.rmdir()
        raise OSError(error.errno, error.strerror, str(folder)) from error
    finally:
        unfinished.difference_update(parts.values())


def remove(paths: Iterable[Path]) -> None:
    """Remove files and folders that are there."""
    for path in list(paths):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        with suppress(OSError):
            path.unlink()


def check_targets(outputs: Sequence[str], pictures: Sequence[str] = ()) -> None:
    """Raise BadInput before a long run for what could only fail after it: files to be written, "-" standing for none."""
    files = [Path(file) for file in (*outputs, *pictures) if file != "-"]
    for file in files:
        if file.is_dir():
            raise BadInput(f"{file} is a folder; give a file in it")
        if not file.parent.is_dir():
            raise BadInput(f"{file}: there is no folder {file.parent}; make it first")
    for k, file in enumerate(files):
        if file.resolve() in (other.resolve() for other in files[:k]):
            raise BadInput(f"{file}: two outputs go to the same file")
    for file in pictures:
        if Path(file).suffix not in (".png", ".pdf", ".svg"):
            raise BadInput(f"{file}: pictures are .png, .pdf or .svg")
