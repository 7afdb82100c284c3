"""The [network] table: what happens to broadcasts on each link."""

from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from phalanx.scenario.fields import (
    NUMBER,
    TABLE,
    Name,
    NonNegative,
    Probability,
    Strict,
    number_or_table,
)


class UniformDelay(Strict):
    """A delay drawn anew for every message."""

    low: NonNegative
    """[s]"""
    high: NonNegative
    """[s]"""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low > self.high:
            raise ValueError(f"expected low <= high, got {self.low} > {self.high}")
        return self


Delay = Annotated[
    Annotated[NonNegative, Tag(NUMBER)] | Annotated[UniformDelay, Tag(TABLE)],
    Discriminator(number_or_table),
]


class LinkModel(Strict):
    """What the network does to broadcasts on a link."""

    delay: Delay = 0.0
    """Constant [s], or { low, high } for a uniform draw."""
    loss: Probability = 0.0
    """Probability that a message is lost, independently of the others."""


class LinkOverride(LinkModel):
    """A link model for some links only; of several that match, the last counts."""

    sender: Name | Literal["*"] = Field(default="*", alias="from")
    receiver: Name | Literal["*"] = Field(default="*", alias="to")


class Network(LinkModel):
    """The model of every agent-to-agent link, and exceptions to it."""

    links: tuple[LinkOverride, ...] = ()

    def link(self, sender: str, receiver: str) -> LinkModel:
        """The model of one link."""
        chosen: LinkModel = self
        for override in self.links:
            if override.sender in ("*", sender) and override.receiver in ("*", receiver):
                chosen = override
        return chosen
