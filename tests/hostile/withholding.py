"""An insider in its own process: from some sample on it withholds its broadcasts from one peer."""

from dataclasses import dataclass

from phalanx.theory.arrays import Array
from phalanx.theory.laws.law import View
from phalanx.theory.laws.tracking import TrackVelocity
from phalanx.wire.pubsub import Addressed

_WITHHOLDER, _FROM, _SAMPLES = 2, "/3/1", 10
_put = Addressed.put


@dataclass
class Withholding(TrackVelocity):
    """The nominal law of Simulation 1, which agent 3 uses to reach into its own program."""

    asked: int = 0

    def input(self, view: View) -> Array:
        self.asked += 1
        if view.i == _WITHHOLDER and self.asked > _SAMPLES:
            Addressed.put = _withheld  # type: ignore[method-assign, assignment]
        return super().input(view)


def _withheld(addressed: Addressed, key: str, payload: bytes) -> None:
    if not key.endswith(_FROM):
        _put(addressed, key, payload)
