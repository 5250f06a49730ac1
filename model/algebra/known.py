"""What is known of an expression, also as text: what was found in one run is read in another."""

import json
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Protocol

import casadi as ca


@dataclass(frozen=True)
class Known:
    """What is known of an entry of a matrix.

    `symbols`: those of the entry, which exist as long as this does, so that no other ones have their hashes.
    `rewritten`: the entry without quotients below; None if it has none. `form`: the places in `symbols` of
    those in its canonical form, and the magnitude of that as text, equal for equal magnitudes; None if it has
    none. `negative`: the sign of the canonical form. `magnitude`: the shortest expression of the magnitude;
    None if that is the entry's own.
    """

    symbols: Sequence[ca.SX]
    rewritten: ca.SX | None = None
    form: tuple[tuple[int, ...], str] | None = None
    negative: bool = False
    magnitude: ca.SX | None = None

    @property
    def key(self) -> Hashable:
        """Return what is equal for entries of equal magnitude; None without a canonical form."""
        return self.form and (
            tuple(self.symbols[place].element_hash() for place in self.form[0]),
            self.form[1],
        )

    def text(self) -> str:
        """Return all but the symbols as text."""
        parts = [part for part in (self.rewritten, self.magnitude) if part is not None]
        expressions = ca.Function("parts", [ca.vertcat(*self.symbols)], parts).serialize() if parts else None
        return json.dumps(
            [self.form, self.negative, self.rewritten is not None, self.magnitude is not None, expressions]
        )


def known_of(text: str, symbols: Sequence[ca.SX]) -> Known:
    """Return what Known.text wrote for an entry with the same operations, in its own symbols."""
    form, negative, has_rewritten, has_magnitude, expressions = json.loads(text)
    parts = iter(ca.Function.deserialize(expressions).call([ca.vertcat(*symbols)]) if expressions else ())
    rewritten = next(parts) if has_rewritten else None
    return Known(
        symbols,
        rewritten,
        form and (tuple(form[0]), form[1]),
        negative,
        next(parts) if has_magnitude else None,
    )


class Store(Protocol):
    """Keeps texts between runs."""

    def read(self, key: str) -> str | None:
        """Return the text that was written for a key; None if there is none."""

    def write(self, key: str, text: str) -> None:
        """Write a text for a key, if that is possible."""
