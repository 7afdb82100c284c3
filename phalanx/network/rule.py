"""The protocol of link rules: a rule drops, delays, duplicates or corrupts single messages."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import msgspec

from phalanx.network.draws import Draws
from phalanx.theory.arrays import Array, Mask
from phalanx.theory.expressions.user_methods import (
    MistakenMethodError,
    check_of,
    is_built_in,
)


class Copy(msgspec.Struct, frozen=True):
    """One copy of a message that a rule lets through.

    >>> Copy(after=0.02).corrupt
    False
    """

    after: float = 0.0
    """Delay since it arrived at the rule [s]."""
    corrupt: bool = False
    """True for a flipped byte, which the receiver's seal detects."""


Treatment = tuple[Copy, ...]
"""Copies of a message that a rule lets through: none, one, or several."""

DELIVER: Treatment = (Copy(),)
"""The message as it is."""
DROP: Treatment = ()
"""No copy: the message is lost."""
DUPLICATE: Treatment = (Copy(), Copy())
"""The message twice."""
CORRUPT: Treatment = (Copy(corrupt=True),)
"""The message with a flipped byte, which its receiver refuses."""

BASIC = ""
"""The purpose of the two draws that each message has on each link: for loss, and for delay."""


def delay(after: float) -> Treatment:
    """Deliver the message with a delay [s].

    >>> delay(0.02)
    (Copy(after=0.02, corrupt=False),)
    """
    return (Copy(after),)


class DrawsByPurpose(Protocol):
    """Tables of draws, by purpose."""

    def __getitem__(self, purpose: str, /) -> Draws:
        """Return the table of a purpose."""


class Message(msgspec.Struct, frozen=True):
    """One message on one link, as it arrives at a rule.

    >>> Message("a", "b", 0, 1.0, 0.5, distance=3.0, copy=0, previous=-np.inf, tables={}).t
    1.5
    """

    sender: str
    receiver: str
    k: int
    """Its sequence number on the link."""
    sent: float
    """Time of sending [s]."""
    waited: float
    """Delay by the rules before this one [s]."""
    distance: float
    """From sender to receiver [m]; NaN unless a rule of the link asks for distances."""
    copy: int
    """0; 1, 2, ... for a duplicate made by a rule before this one."""
    previous: float
    """Time at which the message before it left this rule [s]; -inf if there was none."""
    tables: DrawsByPurpose
    """Tables of draws of this link and this rule."""

    @property
    def t(self) -> float:
        """Time of arrival at this rule [s]."""
        return self.sent + self.waited

    def draw(self, purpose: str, column: int = 0, correlation: float = 0.0) -> float:
        """Return a uniform draw in [0, 1) for this message, the same at every call.

        Args:
            purpose: draws of different purposes are independent.
            column: 0 or 1: each purpose has two draws for every message.
            correlation: of consecutive messages: probability that the draw is that of the one
                before. The distribution does not change.
        """
        name = purpose if self.copy == 0 else f"{purpose} of copy {self.copy}"
        k = self.k
        if correlation > 0.0:
            k = self.tables[f"{name} kept"].last(k, AtLeast(column, correlation))
        return self.tables[name].value(k, column)


class AtLeast(NamedTuple):
    """Rows of draws with a draw of at least this size in a column."""

    column: int
    least: float

    def __call__(self, rows: Array, /) -> Mask:
        return rows[:, self.column] >= self.least


class Rule(Protocol):
    """The treatment of messages: a pure function of the message, its link and the seed.

    >>> class Rain:
    ...     def treat(self, message):
    ...         return DROP if message.distance > 30.0 else DELIVER
    >>> link = "a", "b", 0, 0.0, 0.0
    >>> Rain().treat(Message(*link, distance=0.0, copy=0, previous=-np.inf, tables={}))
    (Copy(after=0.0, corrupt=False),)
    """

    def treat(self, message: Message) -> Treatment:
        """Return DELIVER, DROP, DUPLICATE, CORRUPT, delay(after), or any copies."""


def asks_distance(rule: Rule) -> bool:
    """Return a rule's attribute asks_distance: True if it needs Message.distance.

    A user's rule needs it unless it says otherwise.
    """
    return bool(getattr(rule, "asks_distance", not is_built_in(rule)))


@dataclass(frozen=True)
class During:
    """A rule in force for messages sent in [begin, end), whatever delays them before it."""

    begin: float
    """[s]"""
    end: float
    """[s]"""
    rule: Rule
    field: str = ""
    """Of a user's rule: its name in its table, which keeps its draws apart."""

    @property
    def asks_distance(self) -> bool:
        return asks_distance(self.rule)

    def treat(self, message: Message) -> Treatment:
        return self.rule.treat(message) if self.begin <= message.sent < self.end else DELIVER


@dataclass(frozen=True)
class Cut:
    """Loss of every message."""

    def treat(self, message: Message) -> Treatment:
        return DROP


@check_of(Rule, "treat")
def _treatment(rule: Rule, copies: Any, message: Message) -> Treatment:
    if isinstance(copies, tuple | list) and all(_arrives(copy, message) for copy in copies):
        return tuple(copies)
    expected = "DELIVER, DROP, or a tuple of copies that arrive after sending"
    raise MistakenMethodError(rule, "treat", expected, repr(copies))


def _arrives(copy: Any, message: Message) -> bool:
    if not isinstance(copy, Copy) or not isinstance(copy.after, int | float):
        return False
    return 0.0 <= message.waited + copy.after < math.inf
