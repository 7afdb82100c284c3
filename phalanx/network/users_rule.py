"""A link rule of a user's own, whose every treatment is checked."""

import math
from typing import Any

from phalanx.network.rule import Copy, Message, Rule, Treatment
from phalanx.theory.expressions.asked import MistakenMethodError, ask

_EXPECTED = "DELIVER, DROP, or a tuple of copies that arrive after sending"


class UsersRule:
    """Asks the rule; what it returns is a treatment, or a mistake that names it."""

    def __init__(self, rule: Rule) -> None:
        self._rule = rule
        self.asks_distance = bool(getattr(rule, "asks_distance", True))
        """A user's is taken to look at distances."""

    def __str__(self) -> str:
        return str(self._rule)

    def treat(self, message: Message) -> Treatment:
        """What the rule makes of the message.

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
