"""Links: delivery of messages, a pure function of (seed, link, number, time, distance)."""

import math
from dataclasses import dataclass
from typing import Literal

import msgspec

from phalanx.network.delay import ConstantDelay
from phalanx.network.draws import Draws, Seeds, Tables
from phalanx.network.loss import RandomLoss
from phalanx.network.rule import (
    DELIVER,
    Copy,
    DrawsByPurpose,
    Message,
    Rule,
    Treatment,
    asks_distance,
)
from phalanx.theory.expressions.user_methods import error_line

LOSS, DELAY, TRACE = "loss", "delay", "trace"
Kind = Literal["broadcast", "sample", "actuation"]
"""Messages of a link: broadcasts between agents, or, within one robot, states from its sensors
and inputs to its actuators."""


class RuleError(RuntimeError):
    """A rule failed, or returned an impossible treatment; the message names it."""


@dataclass(frozen=True)
class Stage:
    """One rule of a link."""

    field: str
    """Its name in its table: "loss". It is part of the key of draws, so a link with a model of its
    own has the draws of the general model."""
    rule: Rule
    declared: int = -1
    """Its index in phalanx.scenario.declared.Links.declared; -1: set by a command."""


@dataclass(frozen=True)
class LinkModel:
    """The rules that act on the messages of a link, one after the other."""

    stages: tuple[Stage, ...] = ()

    def changed(self, loss: float | None, delay: float | None) -> "LinkModel":
        """Return the model with loss and delay [s] replaced where given."""
        model = self
        if delay is not None:
            model = model._with(Stage(DELAY, ConstantDelay(delay)))
        if loss is not None:
            model = model._with(Stage(LOSS, RandomLoss(loss)))
        return model

    @property
    def loss(self) -> float:
        """Mean share of messages lost by its field `loss`."""
        shares = [getattr(s.rule, "mean", 0.0) for s in self.stages if s.field == LOSS]
        return float(sum(shares))

    def described(self, field: str) -> str:
        """Return the rules of one field as a text."""
        return ", ".join(str(stage.rule) for stage in self.stages if stage.field == field) or "none"

    def _with(self, new: Stage) -> "LinkModel":
        fields = [stage.field for stage in self.stages]
        if new.field not in fields:
            return LinkModel((new, *self.stages))
        return LinkModel(tuple(new if s.field == new.field else s for s in self.stages))


class Delivery(msgspec.Struct, frozen=True):
    """The result of sending one message over a link."""

    copies: tuple[Copy, ...]
    """Copies that arrive, with their delays since sending; empty if it was lost."""
    faults: tuple[int, ...]
    """Numbers of the declared rules that had an effect."""

    @property
    def delay(self) -> float | None:
        """Delay of the first intact copy [s]; None if there is none."""
        intact = [copy.after for copy in self.copies if not copy.corrupt]
        return min(intact) if intact else None


_AS_SENT = Delivery(DELIVER, ())
"""Of a link without rules."""


class _LinkStage:
    """A stage of one link, with its draws and its memory."""

    __slots__ = ("last_time", "stage", "tables")

    def __init__(self, stage: Stage, tables: DrawsByPurpose) -> None:
        self.stage, self.tables = stage, tables
        self.last_time = -math.inf
        """Time at which the last message left it [s]."""


class _TablesOfRule:
    """Draws of one of the rules in a list."""

    def __init__(self, tables: Tables, field: str) -> None:
        self._tables, self._field = tables, field

    def __getitem__(self, purpose: str) -> Draws:
        return self._tables[f"{self._field} {purpose}"]


class Link:
    """One direction between two agents, simulated by the receiver, or a link within a robot."""

    def __init__(
        self,
        seeds: Seeds | int,
        sender: str,
        receiver: str,
        model: LinkModel,
        kind: Kind = "broadcast",
    ) -> None:
        """Draws are keyed by seeds, names and kind, so that links are independent."""
        self._as_declared = model
        self._ends = sender, receiver
        purpose = () if kind == "broadcast" else (kind,)
        self._tables = Tables(seeds, "link", sender, receiver, *purpose, width=2)
        self.override(None, None)

    def override(self, loss: float | None, delay: float | None) -> None:
        """Use the declared model with loss and delay [s] replaced where given.

        Rules lose their memory.
        """
        stages = self._as_declared.changed(loss, delay).stages
        self._stages = [_LinkStage(stage, self._draws_of(stage.field)) for stage in stages]
        self.free = not stages
        """True if no rule acts on its messages."""
        self.asks_distance = any(asks_distance(stage.rule) for stage in stages)
        """True if the delivery depends on the distance between the ends."""

    def fate(
        self, k: int, sent: float = 0.0, distance: float = math.nan, now: float = 0.0
    ) -> Delivery:
        """Compute the delivery of message k.

        Args:
            k: sequence number; in increasing order if a rule has a memory.
            sent: time of sending [s].
            distance: between the ends [m].
            now: when this is decided [s].

        Raises:
            RuleError: a rule raised, or lets a message arrive before it was sent.
        """
        if self.free:
            return _AS_SENT
        copies: Treatment = DELIVER
        faults: tuple[int, ...] = ()
        self._tables.decide(k, now)
        for link_stage in self._stages:
            came, copies, stage = copies, (), link_stage.stage
            try:
                for number, copy in enumerate(came):
                    message = Message(
                        *self._ends,
                        k,
                        sent,
                        copy.after,
                        distance,
                        number,
                        link_stage.last_time,
                        link_stage.tables,
                    )
                    treatment, t = stage.rule.treat(message), sent + copy.after
                    if treatment == DELIVER:
                        link_stage.last_time = t
                        copies += (copy,)
                        continue
                    if 0 <= stage.declared not in faults:
                        faults += (stage.declared,)
                    for new in treatment:
                        after = copy.after + new.after
                        if not 0.0 <= after < math.inf:
                            raise ValueError(f"expected an arrival after sending, got {treatment}")
                        link_stage.last_time = t + new.after
                        copies += (Copy(after, copy.corrupt or new.corrupt),)
            except Exception as error:  # a user's rule may raise anything
                text = "{} from {} to {}".format(k, *self._ends)
                problem = f"rule {stage.field} failed at message {text}: {error_line(error)}"
                raise RuleError(problem) from error
        return Delivery(copies, faults)

    def _draws_of(self, field: str) -> DrawsByPurpose:
        # Built-in rules have different purposes; users' rules may not, so their place is added.
        return _TablesOfRule(self._tables, field) if "." in field else self._tables
