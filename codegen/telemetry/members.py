"""Members of C structs, read from the text of our own headers,
so that what is saved is what the struct has."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

STRUCT = re.compile(r"typedef struct (\w+) \{\n(.*?)^\} \1;", re.MULTILINE | re.DOTALL)
ENUM = re.compile(r"^typedef enum (\w+) \{", re.MULTILINE)
COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
DECLARATION = re.compile(r"\s*(const )?(\w+) ([^;]+);")
REALS, INTEGERS = ("float", "double"), ("int", "int32_t", "uint32_t")


@dataclass(frozen=True)
class Member:
    """Numbers of a struct that follow each other: the path of the first, such as motors[0].gear, their number
    (0 for a pointer), and whether they are reals. `owner` is the path of the struct that they are in.
    """

    path: str
    count: int
    real: bool
    owner: str


class Structs:
    """The structs that texts of C define."""

    def __init__(self, texts: Iterable[str]):
        self._bodies: dict[str, str] = {}
        self._enums: set[str] = set()
        for text in texts:
            plain = COMMENT.sub("", text)
            self._bodies |= dict(STRUCT.findall(plain))
            self._enums |= set(ENUM.findall(plain))

    def members(self, struct: str, path: str = "") -> Iterator[Member]:
        """Yield the members of a struct in their order, those of its own structs too. Raises KeyError for an
        unknown type."""
        for pointed, kind, names in DECLARATION.findall(self._bodies[struct]):
            for name in names.split(","):
                found = re.fullmatch(r"(\*?)(\w+)(?:\[(\w+)\])?", name.strip())
                if found is None:
                    raise KeyError(f"{struct}: {name}")
                place, length = path + found[2], int(found[3] or 1)
                if pointed or found[1]:
                    yield Member(place, 0, False, path)
                elif kind in (*REALS, *INTEGERS) or kind in self._enums:
                    yield Member(place, length, kind in REALS, path)
                else:
                    for k in range(length):
                        inner = f"{place}[{k}]" if found[3] else place
                        yield from self.members(kind, f"{inner}.")


def joined(members: Iterable[Member]) -> list[Member]:
    """Return the numbers; those of the same width that follow each other in one struct,
    without a gap on any machine, as one."""
    result: list[Member] = []
    for member in members:
        last = result[-1] if result else None
        if last and last.count and member.count and (last.real, last.owner) == (member.real, member.owner):
            result[-1] = Member(last.path, last.count + member.count, last.real, last.owner)
        else:
            result.append(member)
    return [each for each in result if each.count]


def described(members: Mapping[str, Sequence[Member]]) -> str:
    """Return a text that changes if a name, an order or a kind does: the layout of an image."""
    numbers = [(group, each) for group, several in members.items() for each in several if each.count]
    return "\n".join(
        f"{group} {each.path} {each.count} {'real' if each.real else 'int'}" for group, each in numbers
    )
