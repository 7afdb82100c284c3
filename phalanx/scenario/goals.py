"""The goals of agents as a scenario has them: a point, or a table with a type."""

from typing import Any

from pydantic import ConfigDict, RootModel, model_validator

from phalanx.schema.fields import REFERENCE, Table, built
from phalanx.schema.registry import is_users
from phalanx.theory.laws.attacks import Chase, WorstCase
from phalanx.theory.laws.goals import Follow, Reference
from phalanx.theory.laws.law import Law
from phalanx.theory.laws.lookahead import WorstLookahead
from phalanx.theory.laws.script import Script
from phalanx.theory.laws.tracking import Pursue

_WITHOUT_GOAL = (Pursue, Chase, WorstCase, WorstLookahead, Script)


class GoalField(RootModel[Table]):
    """An agent's goal: { type = "path", points, speed }, for example, or a point [x, y]."""

    model_config = ConfigDict(frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _table(cls, value: Any) -> Any:
        if isinstance(value, list | tuple):
            return {"type": "point", "position": value}
        if not isinstance(value, dict | GoalField):
            raise ValueError("expected a point such as [4.0, 2.0], or a table with a type")
        return value

    @model_validator(mode="after")
    def _resolve(self) -> "GoalField":
        self.reference()
        return self

    def reference(self) -> Reference:
        """Build the reference that the table describes; it is one agent's own."""
        found: Reference = built(REFERENCE, Reference, self.root)
        return found

    @property
    def axes(self) -> int | None:
        """Dimension of the goal's space; None of a user's class, which is asked at x(0)."""
        return None if is_users(self.root) else getattr(self.reference(), "axes", None)

    @property
    def leader(self) -> str | None:
        """The name of the agent that the goal follows."""
        reference = self.reference()
        return reference.agent if isinstance(reference, Follow) else None

    def __repr__(self) -> str:
        return repr(self.root)


def steers_by_goal(law: Law) -> bool:
    """Return whether a law uses its agent's goal; of a user's law it is assumed."""
    return not isinstance(law, _WITHOUT_GOAL)
