"""The distribution of a field of a scenario, as a study draws it or a search varies it."""

import math
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from phalanx.schema.fields import Finite, Strict

Values = Annotated[tuple[Any, ...], Field(min_length=1)]


class Distribution(Strict):
    """A distribution of one field: exactly one of the three."""

    uniform: tuple[Finite, Finite] | None = None
    """Least and largest value."""
    log_uniform: tuple[Finite, Finite] | None = Field(None, alias="log-uniform")
    """Least and largest value, both positive; their logarithm is uniform."""
    choice: Values | None = None
    """Values of equal probability."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        given = [each for each in (self.uniform, self.log_uniform, self.choice) if each is not None]
        if len(given) != 1:
            raise ValueError("expected one of uniform, log-uniform and choice")
        if self.choice is None and not given[0][0] < given[0][1]:
            raise ValueError("expected the least value first, then the largest")
        if self.log_uniform and self.log_uniform[0] <= 0.0:
            raise ValueError("expected positive values for log-uniform")
        return self

    def at(self, quantile: float) -> Any:
        """Return the value at a quantile in [0, 1)."""
        if self.choice is not None:
            return self.choice[int(quantile * len(self.choice))]
        if self.uniform is not None:
            low, high = self.uniform
            return low + quantile * (high - low)
        assert self.log_uniform is not None
        low, high = map(math.log, self.log_uniform)
        return math.exp(low + quantile * (high - low))
