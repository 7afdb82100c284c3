"""Links between agents: the fate of every broadcast, a pure function of (seed, link, number)."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from phalanx.seeded.draws import Draws

NonNegative = Annotated[float, Ge(0)]
Probability = Annotated[float, Ge(0), Le(1)]


@dataclass(frozen=True)
class UniformDelay:
    """A delay drawn anew for every message, uniformly between two bounds."""

    low: NonNegative
    """[s]"""
    high: NonNegative
    """[s]"""

    def __post_init__(self) -> None:
        if self.low > self.high:
            raise ValueError(f"expected low <= high, got {self.low} > {self.high}")


@dataclass(frozen=True)
class LinkModel:
    """What the network does to the broadcasts on a link."""

    delay: NonNegative | UniformDelay = 0.0
    """[s]"""
    loss: Probability = 0.0
    """Probability that a broadcast is lost, independently of the others."""

    def changed(self, loss: float | None, delay: float | None) -> "LinkModel":
        """The same model with loss and delay [s] replaced where given."""
        return LinkModel(
            self.delay if delay is None else delay, self.loss if loss is None else loss
        )


class Link:
    """One direction between two agents, as its receiver decides it."""

    def __init__(self, seed: int, sender: str, receiver: str, model: LinkModel) -> None:
        """Draws are keyed by seed and both names, so no link's fates depend on another's."""
        self._as_declared = model
        self._draws = Draws(seed, "link", sender, receiver, width=2)
        self.become(model)

    def become(self, model: LinkModel) -> None:
        """Follow another model for the broadcasts not decided yet."""
        self.model = model
        self._random = model.loss > 0.0 or isinstance(model.delay, UniformDelay)

    def override(self, loss: float | None, delay: float | None) -> None:
        """Follow the model as declared, with loss and delay [s] replaced where given."""
        self.become(self._as_declared.changed(loss, delay))

    def fate(self, k: int) -> float | None:
        """Delay of broadcast k [s], or None if it is lost."""
        lost, place = self._draws[k] if self._random else (1.0, 0.0)
        if lost < self.model.loss:
            return None
        delay = self.model.delay
        if isinstance(delay, UniformDelay):
            return delay.low + float(place) * (delay.high - delay.low)
        return delay
