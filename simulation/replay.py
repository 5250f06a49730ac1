"""A record of what a target was asked and what it answered, done once more and compared bit by bit.

A record is text, one line a call, in the order of the calls; a number is the 32 bits of a float or an int as 8 hexadecimal
digits, a struct its numbers in the order of its header:

    noslip record 1
    robot labmate
    law type_iv_line
    model MODEL_SHA256                     as in the banner of the law's header
    law_init 0 42f00000 ... -> 0           params, config, gains, options -> status
    law_step 0 3f800000 ... -> 0 41c6...   state, reference -> status, tau
    path_update 0 ... -> 0 ...             x, y, heading, forward speed -> status, guide
    end 3                                  how many calls

After the name of an operation comes the number of the object, from 0: of which law, path, ...; the operations and what they take
and answer are those of firmware/pil/pil.h. `noslip simulate --record` writes such a file. One of a board of your own is made by
logging the structs that go into init and step of the float C and what these answer, and writing them down like this.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..readers.errors import BadInput
from ..readers.files import read_input

if TYPE_CHECKING:
    from ..controllers.pil import Call
    from ..model.law import ControlLaw

FIRST = "noslip record 1"
NUMBER = struct.Struct("<I")
MOST = 1024  # MB of a record


@dataclass(frozen=True)
class Record:
    """The calls of a law's image; `lines` says where in the file each stands."""

    law: "ControlLaw"
    calls: "Sequence[Call]"
    lines: Sequence[int]


def record_text(robot: str, law: "ControlLaw", calls: "Sequence[Call]") -> str:
    """A record as text; `robot` as find_robot takes it."""
    from ..codegen.files import fingerprint

    head = [FIRST, f"robot {robot}", f"law {law.name}", f"model {fingerprint(law.system, law)}"]
    body = [
        " ".join([call.operation, str(call.number), *_words(call.given), "->", str(call.status), *_words(call.answer)])
        for call in calls
    ]
    return "\n".join([*head, *body, f"end {len(calls)}"]) + "\n"


def read_record(file: str, trusted: bool = False) -> Record:
    """Read a record. Raises BadInput, naming the file and the line, for anything that is none or that is not whole.

    `trusted`: a robot's file that it names may be run.
    """
    from ..codegen.files import fingerprint
    from ..readers.robots import check_trust, find_robot, law_of

    try:
        lines = read_input(file, MOST).decode("ascii").splitlines()
    except UnicodeDecodeError as error:
        raise BadInput(f"{file}: not a record: it holds more than ASCII; give what simulate --record wrote") from error
    if not lines or lines[0] != FIRST:
        raise BadInput(f"{file}: not a record: its first line is not {FIRST!r}")
    robot, name, model = (_entry(file, lines, k, key) for k, key in enumerate(("robot", "law", "model"), 1))
    check_trust(robot, file, trusted)
    law = law_of(find_robot(robot), name)
    if model != fingerprint(law.system, law):
        raise BadInput(f"{file}: recorded with another model of {robot}, {name}; replay it with the noslip that generated its C")
    calls = len(lines) - 5
    if lines[-1] != f"end {calls}":
        raise BadInput(f"{file}: not whole: its last line is not 'end {max(calls, 0)}', the number of its calls")
    places = range(5, 5 + calls)
    return Record(law, [_call(line, f"{file}:{k}") for line, k in zip(lines[4:-1], places, strict=True)], places)


def first_difference(record: Record, session, backend: str) -> str | None:
    """What differs first when a session answers the calls of a record; None where nothing does.

    Raises BadInput where the record asks for what cannot be, and where it is too long or too short.
    """
    from ..controllers.pil import TargetFault

    for call, line in zip(record.calls, record.lines, strict=True):
        try:
            status, answer = session.call(call.operation, call.number, call.given)
        except TargetFault as fault:
            raise BadInput(f"line {line}: {fault}") from fault
        what = f"line {line}: {call.operation} {call.number}"
        if len(answer) != len(call.answer):
            raise BadInput(f"{what} has {len(call.answer) // 4} numbers as answer, it must have {len(answer) // 4}")
        if status != call.status:
            return f"{what} answered status {call.status}, on {backend} {status}"
        for k, (then, now) in enumerate(zip(_words(call.answer), _words(answer), strict=True), 1):
            if then != now:
                return f"{what}: number {k} of the answer was {_shown(then)}, on {backend} it is {_shown(now)}"
    return None


def _entry(file: str, lines: Sequence[str], k: int, key: str) -> str:
    found = lines[k].split(" ", 1) if k < len(lines) else [""]
    if found[0] != key or len(found) != 2 or not found[1]:
        raise BadInput(f"{file}:{k + 1}: here must be {key!r} and its value")
    return found[1]


def _call(line: str, where: str) -> "Call":
    from ..controllers.pil import OPERATIONS, Call

    given, arrow, answered = (part.split() for part in line.partition("->"))
    if not arrow or len(given) < 2 or not answered or given[0].upper() not in OPERATIONS:
        raise BadInput(f"{where}: not a call: operation, number, numbers, ->, status, numbers")
    try:
        number, status = int(given[1]), int(answered[0])
        words = [b"".join(map(_word, part)) for part in (given[2:], answered[1:])]
        struct.pack("<Ii", number, status)
    except (ValueError, struct.error):
        raise BadInput(f"{where}: not a call: numbers are 8 hexadecimal digits, object and status whole numbers") from None
    return Call(given[0], number, words[0], status, words[1])


def _word(text: str) -> bytes:
    if len(text) != 8:
        raise ValueError(text)
    return bytes.fromhex(text)[::-1]


def _words(data: bytes) -> Iterator[str]:
    return (f"{word:08x}" for (word,) in NUMBER.iter_unpack(data))


def _shown(word: str) -> str:
    """A number's bits and, as a float, its value."""
    return f"{word} ({struct.unpack('>f', bytes.fromhex(word))[0]:.9g})"
