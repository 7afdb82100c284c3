"""What stands still in a scenario: its [[obstacles]] and [[limits]]."""

from typing import Annotated, Any, Self

from pydantic import ConfigDict, Discriminator, PrivateAttr, RootModel, Tag, model_validator

from phalanx.scenario.fields import LIMIT, SPHERE, WALL, Table, built
from phalanx.theory.safety.limits import Boundary, Limit
from phalanx.theory.safety.obstacles import Sphere, Wall


def _sphere_or_wall(value: Any) -> str:
    has_normal = "normal" in value if isinstance(value, dict) else isinstance(value, Wall)
    return WALL if has_normal else SPHERE


ObstacleField = Annotated[
    Annotated[Sphere, Tag(SPHERE)] | Annotated[Wall, Tag(WALL)], Discriminator(_sphere_or_wall)
]


class LimitField(RootModel[Table]):
    """A [[limits]] table, with the limit that it describes."""

    model_config = ConfigDict(frozen=True)
    _limit: Limit = PrivateAttr()

    @model_validator(mode="after")
    def _resolve(self) -> Self:
        self._limit = built(LIMIT, Limit, self.root)
        return self

    @property
    def boundary(self) -> Boundary:
        """The limit as the other side of pairs."""
        return Boundary(self._limit)
