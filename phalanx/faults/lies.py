"""Lies: what a compromised member says of its input, instead of what it applies.

A lie is a pure function of seed, agent, step and receiver, and of what the agent applies. So the
plant, which knows that, finds out afterwards which of the declared lies it was.
"""

from collections.abc import Callable
from typing import NamedTuple

from phalanx.network.claim import Claim
from phalanx.seeded.draws import Draws

Past = Callable[[int], tuple[float, ...] | None]
"""The input that an agent applied so many steps ago; None if there was none."""


class Telling(NamedTuple):
    """An agent about to tell one peer of its input."""

    seed: int
    sender: str
    receiver: str
    k: int
    """The broadcast's number."""
    claim: Claim
    """What it would say: the truth, or what the lies before have made of it."""
    past: Past


Lie = Callable[[Telling], Claim]
"""What is said instead."""


def says(u: tuple[float, ...]) -> Lie:
    """It says that it applies u, whatever it applies."""
    return lambda telling: Claim(telling.claim.t_apply, u)


def says_zero(telling: Telling) -> Claim:
    """It says that it applies nothing."""
    return Claim(telling.claim.t_apply, tuple(0.0 for _ in telling.claim.u))


def says_opposite(telling: Telling) -> Claim:
    """It says that it applies the opposite."""
    return Claim(telling.claim.t_apply, tuple(-value for value in telling.claim.u))


def equivocates(telling: Telling) -> Claim:
    """It tells every peer another input, at every step, with components between u and -u."""
    claim = telling.claim
    table = Draws(
        telling.seed, "equivocation", telling.sender, telling.receiver, width=len(claim.u)
    )
    turned = zip(claim.u, table[telling.k].tolist(), strict=True)
    return Claim(claim.t_apply, tuple(value * (2.0 * draw - 1.0) for value, draw in turned))


def replays(steps: int) -> Lie:
    """It says what it applied so many steps ago, as if it were new.

    An old broadcast as it was, number and all, is refused by whoever had it.
    """

    def told(telling: Telling) -> Claim:
        old = telling.past(steps)
        return telling.claim if old is None else Claim(telling.claim.t_apply, old)

    return told


def misdates(later: float) -> Lie:
    """It says that its input takes effect so much later than it does [s]; earlier if negative."""
    return lambda telling: Claim(telling.claim.t_apply + later, telling.claim.u)


class DeclaredLie(NamedTuple):
    """A lie, when and to whom."""

    number: int
    """Its place among all that the scenario declares."""
    begin: float
    """[s]"""
    end: float
    """[s]; the truth again at this instant."""
    to: frozenset[str]
    """Whom it is told; if empty, everybody."""
    lie: Lie

    def concerns(self, receiver: str, t: float) -> bool:
        """Whether it is told to this peer at t [s]."""
        return self.begin <= t < self.end and (not self.to or receiver in self.to)


class Told(NamedTuple):
    """What was said to one peer."""

    claim: Claim
    lies: tuple[int, ...]
    """Numbers of the declared lies that changed it."""


class Lies:
    """One agent's lies, as declared: one made of the other, where several are told at once."""

    def __init__(self, seed: int, name: str, lies: tuple[DeclaredLie, ...], reach: int) -> None:
        """reach: how many steps back the lies look."""
        self.reach = reach
        self.declared = lies
        self._seed, self._name = seed, name

    def tell(self, receiver: str, k: int, truth: Claim, past: Past) -> Told:
        """What the agent tells one peer with broadcast k."""
        claim, told = truth, []
        for declared in self.declared:
            if declared.concerns(receiver, truth.t_apply):
                before = claim
                claim = declared.lie(Telling(self._seed, self._name, receiver, k, claim, past))
                told += [declared.number] if claim != before else []
        return Told(claim, tuple(told))
