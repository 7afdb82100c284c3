"""The [network] table: what happens to broadcasts on each link."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from phalanx.network.link import LinkModel, UniformDelay
from phalanx.scenario.fields import (
    NUMBER,
    TABLE,
    Name,
    NonNegative,
    Probability,
    Strict,
    number_or_table,
)

Delay = Annotated[
    Annotated[NonNegative, Tag(NUMBER)] | Annotated[UniformDelay, Tag(TABLE)],
    Discriminator(number_or_table),
]


class LinkTable(Strict):
    """A link model as a scenario writes it."""

    delay: Delay = 0.0
    """Constant [s], or { low, high } for a uniform draw."""
    loss: Probability = 0.0
    """Probability that a message is lost, independently of the others."""

    def model(self) -> LinkModel:
        """The model that the table describes."""
        return LinkModel(self.delay, self.loss)


class LinkOverride(LinkTable):
    """A link model for some links only; of several that match, the last counts."""

    sender: Name | Literal["*"] = Field(default="*", alias="from")
    receiver: Name | Literal["*"] = Field(default="*", alias="to")


class Network(LinkTable):
    """The model of every agent-to-agent link, and exceptions to it."""

    links: tuple[LinkOverride, ...] = ()

    def link(self, sender: str, receiver: str) -> LinkModel:
        """The model of one link."""
        chosen: LinkTable = self
        for override in self.links:
            if override.sender in ("*", sender) and override.receiver in ("*", receiver):
                chosen = override
        return chosen.model()
