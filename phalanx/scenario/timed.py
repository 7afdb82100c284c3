"""What all faults of a time have in common."""

from pydantic import Field

from phalanx.network.rule import Rule
from phalanx.network.window import During
from phalanx.scenario.fields import NonNegative, Positive, Strict


class Timed(Strict):
    """A fault from one time to another."""

    at: NonNegative = 0.0
    """From when on [s]."""
    lasts: Positive = Field(alias="for")
    """For how long [s]."""

    @property
    def end(self) -> float:
        """When it is over [s]."""
        return self.at + self.lasts

    def during(self, rule: Rule) -> Rule:
        """The rule, in force in this fault's time."""
        return During(self.at, self.end, rule)
