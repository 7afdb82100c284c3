"""Link faults: the fate of every broadcast, a pure function of (seed, link, sequence number)."""

from phalanx.scenario.network import LinkModel, UniformDelay
from phalanx.seeded.draws import Draws


class Link:
    """One direction between two agents, as its receiver decides it."""

    def __init__(self, seed: int, sender: str, receiver: str, model: LinkModel) -> None:
        self._model = model
        self._draws = Draws(seed, "link", sender, receiver, width=2)
        self._random = model.loss > 0.0 or isinstance(model.delay, UniformDelay)

    def become(self, loss: float | None, delay: float | None) -> None:
        """Replace loss and delay [s], where given, for the broadcasts not decided yet."""
        changes = {"loss": loss, "delay": delay}
        self._model = LinkModel(
            **{
                name: getattr(self._model, name) if value is None else value
                for name, value in changes.items()
            }
        )
        self._random = self._model.loss > 0.0 or isinstance(self._model.delay, UniformDelay)

    def fate(self, k: int) -> float | None:
        """Delay of broadcast k [s], or None if it is lost."""
        loss, place = self._draws[k] if self._random else (1.0, 0.0)
        if loss < self._model.loss:
            return None
        delay = self._model.delay
        if isinstance(delay, UniformDelay):
            return delay.low + float(place) * (delay.high - delay.low)
        return delay
