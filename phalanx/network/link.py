"""Links: the fate of every message, a pure function of (seed, link, number, time, distance)."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Literal

import msgspec

from phalanx.network.delay import ConstantDelay
from phalanx.network.loss import Chance, RandomLoss
from phalanx.network.rule import DELIVER, Copy, Message, Rule, Treatment, asks_distance
from phalanx.seeded.draws import Draws
from phalanx.theory.expressions.asked import MistakenMethodError

LOSS, DELAY = "loss", "delay"
Kind = Literal["broadcast", "sample", "actuation"]
"""Cargo of a link: inputs from peer to peer, or within one robot, states from its sensors and
inputs to its actuators."""


class RuleError(RuntimeError):
    """A rule failed, or said what cannot be; the message names it."""


@dataclass(frozen=True)
class Stage:
    """A rule in its place on a link."""

    field: str
    """Its name in its table: "loss". Draws go by this name, so an exception to a link
    model draws as the model does."""
    rule: Rule
    declared: int = -1
    """Its place among all that the scenario declares; -1: by command."""


@dataclass(frozen=True)
class LinkModel:
    """The rules that act on the messages of a link, one after the other."""

    stages: tuple[Stage, ...] = ()

    def changed(self, loss: float | None, delay: float | None) -> "LinkModel":
        """The same model with loss and delay [s] replaced where given."""
        model = self
        if delay is not None:
            model = model._with(Stage(DELAY, ConstantDelay(delay)))
        if loss is not None:
            model = model._with(Stage(LOSS, RandomLoss(Chance(loss))))
        return model

    @property
    def loss(self) -> float:
        """The share of messages that its field `loss` asks for."""
        shares = [getattr(s.rule, "mean", 0.0) for s in self.stages if s.field == LOSS]
        return float(sum(shares))

    def described(self, field: str) -> str:
        """A field of the model in words."""
        return ", ".join(str(stage.rule) for stage in self.stages if stage.field == field) or "none"

    def _with(self, new: Stage) -> "LinkModel":
        fields = [stage.field for stage in self.stages]
        if new.field not in fields:
            return LinkModel((new, *self.stages))
        return LinkModel(tuple(new if s.field == new.field else s for s in self.stages))


class Passage(msgspec.Struct, frozen=True):
    """The fate of one message."""

    copies: tuple[Copy, ...]
    """Copies that arrive, each so long after it was sent [s]; none if it was lost."""
    faults: tuple[int, ...]
    """Which of the declared rules had an effect."""

    @property
    def delay(self) -> float | None:
        """Of the first copy that can be read [s]; None if there is none."""
        readable = [copy.after for copy in self.copies if not copy.corrupt]
        return min(readable) if readable else None


class _Place:
    """A stage's place on one link."""

    __slots__ = ("left", "stage", "table")

    def __init__(self, stage: Stage, table: Callable[[str], Draws]) -> None:
        self.stage, self.table = stage, table
        self.left = -math.inf
        """When the last message left it [s]."""


class Link:
    """One direction between two agents, as its receiver decides it, or a robot's own."""

    def __init__(
        self,
        seed: int,
        sender: str,
        receiver: str,
        model: LinkModel,
        kind: Kind = "broadcast",
    ) -> None:
        """Draws are keyed by seed, names and kind, so no link's fates depend on another's."""
        self._as_declared = model
        self._ends = sender, receiver
        purpose = () if kind == "broadcast" else (kind,)
        self._table = cache(partial(_table, seed, "link", sender, receiver, *purpose))
        self.become(model)

    def become(self, model: LinkModel) -> None:
        """Follow another model for the broadcasts not decided yet."""
        self._places = [_Place(stage, self._of_stage(stage.field)) for stage in model.stages]
        self.asks_distance = any(asks_distance(stage.rule) for stage in model.stages)
        """Whether a fate depends on the distance between the two."""

    def override(self, loss: float | None, delay: float | None) -> None:
        """Follow the model as declared, with loss and delay [s] replaced where given."""
        self.become(self._as_declared.changed(loss, delay))

    def fate(self, k: int, sent: float = 0.0, distance: float = math.nan) -> Passage:
        """The fate of message k.

        Args:
            k: sequence numbers come in order, where a rule has a memory.
            sent: when it leaves its sender [s].
            distance: between the two [m].

        Raises:
            RuleError: a rule raised, or lets a message arrive before it was sent.
        """
        copies: Treatment = DELIVER
        faults: tuple[int, ...] = ()
        for place in self._places:
            came, copies, stage = copies, (), place.stage
            try:
                for number, copy in enumerate(came):
                    message = Message(
                        *self._ends, k, sent, copy.after, distance, number, place.left, place.table
                    )
                    treatment, t = stage.rule.treat(message), sent + copy.after
                    if treatment == DELIVER:
                        place.left = t
                        copies += (copy,)
                        continue
                    if 0 <= stage.declared not in faults:
                        faults += (stage.declared,)
                    for new in treatment:
                        after = copy.after + new.after
                        if not 0.0 <= after < math.inf:
                            raise ValueError(f"expected an arrival after sending, got {treatment}")
                        place.left = t + new.after
                        copies += (Copy(after, copy.corrupt or new.corrupt),)
            except Exception as error:  # a user's rule may raise anything
                problem = f"{type(error).__name__}: {error}"
                if isinstance(error, MistakenMethodError):
                    problem = error.told("the link from {} to {}".format(*self._ends))
                raise RuleError(f"rule {stage.field} failed at message {k}: {problem}") from error
        return Passage(copies, faults)

    def _of_stage(self, field: str) -> Callable[[str], Draws]:
        # What fields of a link model draw for differs by purpose; rules of one's own may not know.
        return (lambda purpose: self._table(f"{field} {purpose}")) if "." in field else self._table


def _table(seed: int, *purpose: str) -> Draws:
    return Draws(seed, *filter(None, purpose), width=2)
