"""The protocol of the network: a rule says what becomes of one message, and of nothing else.

A class of your own is a rule if it has the method `treat`; a dozen lines are enough:

    @dataclass(frozen=True)
    class Rain:
        \"\"\"The farther apart, the more is lost.\"\"\"

        per_metre: float

        def treat(self, message):
            return DROP if message.draw("rain") < self.per_metre * message.distance else DELIVER
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import msgspec

from phalanx.arrays import Array, Mask
from phalanx.seeded.draws import Draws
from phalanx.theory.expressions.asked import MistakenMethodError, ask


class Copy(msgspec.Struct, frozen=True):
    """One copy of a message that a rule lets through."""

    after: float = 0.0
    """Later than it came to the rule [s]."""
    corrupt: bool = False
    """With a flipped byte, which the receiver's seal refuses."""


Treatment = tuple[Copy, ...]
"""Copies of a message that a rule lets through: none, one, or several."""

DELIVER: Treatment = (Copy(),)
DROP: Treatment = ()
DUPLICATE: Treatment = (Copy(), Copy())
CORRUPT: Treatment = (Copy(corrupt=True),)

BASIC = ""
"""The purpose of the two draws that each message has on each link: for loss, and for delay."""


def delay(after: float) -> Treatment:
    """Deliver the message so much later [s]."""
    return (Copy(after),)


class Message(msgspec.Struct, frozen=True):
    """One message on its way over one link, as it comes to a rule."""

    sender: str
    receiver: str
    k: int
    """Its sequence number on the link."""
    sent: float
    """When it left its sender [s]."""
    waited: float
    """Delay by the rules before this one [s]."""
    distance: float
    """From sender to receiver [m]; not a number where no rule of the link asks for it."""
    copy: int
    """0; a duplicate made by a rule before this one: 1, 2, ..."""
    previous: float
    """When the message before it left this rule [s]; -inf if there was none."""
    table: Callable[[str], Draws]
    """Tables of draws that belong to this link and this rule, by their purpose."""

    @property
    def t(self) -> float:
        """When it comes to this rule [s]."""
        return self.sent + self.waited

    def draw(self, purpose: str, column: int = 0, kept: float = 0.0) -> float:
        """A uniform draw in [0, 1) of this message's own: the same whenever it is asked for.

        Args:
            purpose: draws of different purposes are independent.
            column: 0 or 1: each purpose has two draws for every message.
            kept: with this probability the draw is that of the message before. So whatever is
                made of draws has exactly this correlation from one message to the next, and the
                distribution that it has without.
        """
        name = purpose if self.copy == 0 else f"{purpose} of copy {self.copy}"
        k = self.k
        if kept > 0.0:
            k = self.table(f"{name} kept").last(k, AtLeast(column, kept))
        return self.table(name).value(k, column)


class AtLeast(NamedTuple):
    """Of rows of draws: those whose draw in a column is as large as that."""

    column: int
    least: float

    def __call__(self, rows: Array, /) -> Mask:
        return rows[:, self.column] >= self.least


class Rule(Protocol):
    """The fate of messages: a pure function of the message, its link and the seed."""

    def treat(self, message: Message) -> Treatment:
        """DELIVER, DROP, DUPLICATE, CORRUPT, delay(after), or any copies."""


def asks_distance(rule: Rule) -> bool:
    """Whether a rule looks at distances: those that do say so."""
    return bool(getattr(rule, "asks_distance", False))


@dataclass(frozen=True)
class During:
    """A rule that is in force for messages that come to it in a span of time."""

    begin: float
    """[s]"""
    end: float
    """[s]; no longer in force at this instant."""
    rule: Rule

    @property
    def asks_distance(self) -> bool:
        """As the rule does."""
        return asks_distance(self.rule)

    def treat(self, message: Message) -> Treatment:
        """As the rule does, in its time."""
        return self.rule.treat(message) if self.begin <= message.t < self.end else DELIVER


@dataclass(frozen=True)
class Cut:
    """A link without a way: nothing comes through."""

    def treat(self, message: Message) -> Treatment:
        """Drop."""
        return DROP


_EXPECTED = "DELIVER, DROP, or a tuple of copies that arrive after sending"


class UsersRule:
    """A rule of a user's own: what it returns is a treatment, or a mistake that names it."""

    def __init__(self, rule: Rule) -> None:
        self._rule = rule
        self.asks_distance = bool(getattr(rule, "asks_distance", True))
        """A user's is taken to look at distances."""

    def __str__(self) -> str:
        return str(self._rule)

    def treat(self, message: Message) -> Treatment:
        """Have the rule treat the message.

        Raises:
            MistakenMethodError: it returned something else, raised, or does not return.
        """
        found = ask(self._rule, "treat", _EXPECTED, message)
        if isinstance(found, tuple | list) and all(_arrives(copy, message) for copy in found):
            return tuple(found)
        raise MistakenMethodError(self._rule, "treat", _EXPECTED, repr(found))


def _arrives(copy: Any, message: Message) -> bool:
    if not isinstance(copy, Copy) or not isinstance(copy.after, int | float):
        return False
    return 0.0 <= message.waited + copy.after < math.inf
