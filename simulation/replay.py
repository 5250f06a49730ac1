"""Repeats recorded calls of a target and compares the results bit by bit.

A record is a text file with one line per call, in order; a number is the 32 bits of a float or an int as 8
hexadecimal digits, a struct consists of its numbers in the order of its header:

    noslip record 1
    robot labmate
    law type_iv_line
    model MODEL_SHA256                     as in the banner of the law's header
    law_init 0 42f00000 ... -> 0           params, config, gains, options -> status
    law_step 0 3f800000 ... -> 0 41c6...   state, reference -> status, tau
    path_update 0 ... -> 0 ...             x, y, heading, forward speed -> status, guide
    end 3                                  number of calls

After the name of an operation comes the number of the object (law, path, ...), from 0; the operations, their
inputs and results are those of firmware/pil/pil.h. `noslip simulate --record` writes such a file. For your
own board, log the structs passed to init and step of the float C and their results, and write them in this
format.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..readers.errors import BadInput
from ..readers.files import read_input
from ..readers.progress import Reported, silent

if TYPE_CHECKING:
    from ..model.law import ControlLaw
    from .controllers.pil import Call

FIRST = "noslip record 1"
NUMBER = struct.Struct("<I")
MOST = 1024  # MB, limit of a record


@dataclass(frozen=True)
class Record:
    """The recorded calls; `lines` are the line numbers in the file."""

    law: "ControlLaw"
    calls: "Sequence[Call]"
    lines: Sequence[int]


def record_text(robot: str, law: "ControlLaw", calls: "Sequence[Call]") -> str:
    """Return a record as text; `robot` as for find_robot."""
    from ..codegen.identity import fingerprint

    head = [FIRST, f"robot {robot}", f"law {law.name}", f"model {fingerprint(law.system, law)}"]
    body = [
        " ".join(
            [
                call.operation,
                str(call.number),
                *_words(call.given),
                "->",
                str(call.status),
                *_words(call.answer),
            ]
        )
        for call in calls
    ]
    return "\n".join([*head, *body, f"end {len(calls)}"]) + "\n"


def read_record(file: str, trusted: bool = False, progress: Reported = silent) -> Record:
    """Read a record. Raises BadInput, naming file and line, if it is invalid or incomplete.

    `trusted`: a robot file that it names may be executed; `progress` receives the number of calls read.
    """
    from ..codegen.identity import fingerprint
    from ..readers.robots import check_trust, find_robot, law_of

    try:
        lines = read_input(file, MOST).decode("ascii").splitlines()
    except UnicodeDecodeError as error:
        raise BadInput(
            f"{file}: not a record: it contains characters that are not ASCII; give a file from simulate "
            "--record"
        ) from error
    if not lines or lines[0] != FIRST:
        raise BadInput(f"{file}: not a record: its first line is not {FIRST!r}")
    robot, name, model = (_entry(file, lines, k, key) for k, key in enumerate(("robot", "law", "model"), 1))
    check_trust(robot, file, trusted)
    law = law_of(find_robot(robot), name)
    if model != fingerprint(law.system, law):
        raise BadInput(
            f"{file}: recorded with another model of {robot}, {name}; replay it with the noslip that "
            "generated its C"
        )
    calls = len(lines) - 5
    if lines[-1] != f"end {calls}":
        raise BadInput(
            f"{file}: incomplete: its last line is not 'end {max(calls, 0)}', the number of its calls"
        )
    places = range(5, 5 + calls)
    read = []
    for line, k in zip(lines[4:-1], places, strict=True):
        read.append(_call(line, f"{file}:{k}"))
        progress(len(read), calls, "calls read")
    return Record(law, read, places)


def first_difference(record: Record, session, backend: str, progress: Reported = silent) -> str | None:
    """Return the first difference between the results of a session and those of a record; None if there is
    none.

    `progress` receives the number of calls repeated. Raises BadInput if a call of the record is invalid, and
    if a result is too long or too short.
    """
    from .controllers.pil import TargetFault

    for done, (call, line) in enumerate(zip(record.calls, record.lines, strict=True)):
        progress(done, len(record.calls), "calls repeated")
        try:
            status, answer = session.call(call.operation, call.number, call.given)
        except TargetFault as fault:
            raise BadInput(f"line {line}: {fault}") from fault
        what = f"line {line}: {call.operation} {call.number}"
        if len(answer) != len(call.answer):
            raise BadInput(
                f"{what} has {len(call.answer) // 4} numbers as result; it must have {len(answer) // 4}"
            )
        if status != call.status:
            return f"{what} returned status {call.status}, on {backend} {status}"
        for k, (then, now) in enumerate(zip(_words(call.answer), _words(answer), strict=True), 1):
            if then != now:
                return (
                    f"{what}: number {k} of the result was {_shown(then)}, on {backend} it is {_shown(now)}"
                )
    return None


def _entry(file: str, lines: Sequence[str], k: int, key: str) -> str:
    found = lines[k].split(" ", 1) if k < len(lines) else [""]
    if found[0] != key or len(found) != 2 or not found[1]:
        raise BadInput(f"{file}:{k + 1}: expected {key!r} and its value")
    return found[1]


def _call(line: str, where: str) -> "Call":
    from .controllers.pil import OPERATIONS, Call

    given, arrow, answered = (part.split() for part in line.partition("->"))
    if not arrow or len(given) < 2 or not answered or given[0].upper() not in OPERATIONS:
        raise BadInput(f"{where}: not a call: operation, number, numbers, ->, status, numbers")
    try:
        number, status = int(given[1]), int(answered[0])
        words = [b"".join(map(_word, part)) for part in (given[2:], answered[1:])]
        struct.pack("<Ii", number, status)
    except (ValueError, struct.error):
        raise BadInput(
            f"{where}: not a call: numbers are 8 hexadecimal digits, object and status are integers"
        ) from None
    return Call(given[0], number, words[0], status, words[1])


def _word(text: str) -> bytes:
    if len(text) != 8:
        raise ValueError(text)
    return bytes.fromhex(text)[::-1]


def _words(data: bytes) -> Iterator[str]:
    return (f"{word:08x}" for (word,) in NUMBER.iter_unpack(data))


def _shown(word: str) -> str:
    """Return the bits of a number and its value as a float."""
    return f"{word} ({struct.unpack('>f', bytes.fromhex(word))[0]:.9g})"
