"""Files written at once or not at all."""

import os
import shutil
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from pathlib import Path

unfinished: set[Path] = set()  # temporary files and folders, to be removed by whoever stops the process


def write_whole(path: str | Path, content: str | bytes) -> None:
    """Write a file through a temporary one beside it; "-" is standard output. Raises OSError naming the file."""
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
        part.write_bytes(data)
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
    """Write files into a folder, made if need be, all or none; `stale` are names in it to remove.

    A file that is right already is not touched. Raises OSError naming the folder.
    """
    new = not folder.exists()
    parts: dict[Path, Path] = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            path = folder / name
            if not path.is_file() or path.read_bytes() != text.encode():
                parts[path] = folder / f".{name}.{os.getpid()}.part"
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
