"""Files written at once or not at all."""

import os
import shutil
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path


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
        part.write_bytes(data)
        if target.exists():
            shutil.copymode(target, part)
        os.replace(part, target)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with suppress(OSError):
            part.unlink()


def write_folder(folder: Path, files: Mapping[str, str], stale: Collection[str] = ()) -> None:
    """Write files into a folder, made if need be; `stale` are names in it to remove. A file that is right is not touched."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.is_file() or path.read_bytes() != text.encode():
            write_whole(path, text)
    for name in stale:
        with suppress(FileNotFoundError):
            (folder / name).unlink()
