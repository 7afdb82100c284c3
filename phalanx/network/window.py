"""Faults that last for a time: partitions, and links that hold what they carry."""

from dataclasses import dataclass

from phalanx.network.rule import DELIVER, DROP, Message, Rule, Treatment, delay


@dataclass(frozen=True)
class During:
    """A rule that is in force for messages that come to it in a span of time."""

    begin: float
    """[s]"""
    end: float
    """[s]; no longer in force at this instant."""
    rule: Rule

    def treat(self, message: Message) -> Treatment:
        """As the rule does, in its time."""
        return self.rule.treat(message) if self.begin <= message.t < self.end else DELIVER


@dataclass(frozen=True)
class Cut:
    """A link without a way: nothing comes through."""

    def treat(self, message: Message) -> Treatment:
        """Drop."""
        return DROP


@dataclass(frozen=True)
class Hold:
    """Whatever would arrive before a time arrives at that time: a full socket, then a flood."""

    until: float
    """[s]"""

    def treat(self, message: Message) -> Treatment:
        """Delay to the release."""
        return delay(max(0.0, self.until - message.t))
