"""Canonical forms of expressions that earlier runs found, in a database in the folder of results.

SQLite lets processes read and write at once. Each row has the digest of its packed text, so that a damaged
one is not used; without a usable folder nothing is kept.
"""

import os
import sqlite3
import zlib
from contextlib import suppress
from functools import cache
from pathlib import Path

from .errors import BadInput
from .kept import check_private, digest, digest_of_code, folder_of_results, version_of

DETERMINE = ("model/algebra",)  # folders whose code determines a form
LIBRARIES = ("casadi", "sympy", "python-flint")
TABLE = (
    "create table if not exists packed_forms (key text primary key, packed blob, digest text) without rowid"
)


class Forms:
    """What `noslip.model.algebra.exact` found of each entry."""

    def read(self, key: str) -> str | None:
        """Return the text that was written for a key; None if there is none, or if it is damaged."""
        with suppress(BadInput, OSError, sqlite3.Error):
            row = _database(folder_of_results(), os.getpid()).execute(
                "select * from packed_forms where key = ?", [digest(key.encode())]
            )
            for _, packed, own in row:
                return zlib.decompress(packed).decode() if digest(packed) == own else None
        return None

    def write(self, key: str, text: str) -> None:
        """Write a text for a key, if the folder can be used."""
        with suppress(BadInput, OSError, sqlite3.Error):
            packed = zlib.compress(text.encode(), 1)
            row = digest(key.encode()), packed, digest(packed)
            _database(folder_of_results(), os.getpid()).execute(
                "insert or replace into packed_forms values (?, ?, ?)", row
            )


@cache
def _database(folder: Path, process: int) -> sqlite3.Connection:
    """Return the database for this code and these libraries; a process must not use that of another,
    which it was forked from."""
    versions = [version_of(library) for library in LIBRARIES]
    path = folder / f"{digest(repr((digest_of_code(DETERMINE), versions)).encode())}.forms"
    with suppress(FileExistsError):
        os.close(os.open(path, os.O_CREAT | os.O_EXCL, 0o600))
    check_private(path)
    database = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    database.execute("pragma synchronous = off")  # a form that is lost or damaged is found again
    database.execute(TABLE)
    return database
