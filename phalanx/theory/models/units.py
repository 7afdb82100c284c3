"""In which units a dynamics' states and inputs are, if it says so."""

from typing import NamedTuple, Protocol, runtime_checkable

from phalanx.theory.models.dynamics import Dynamics


@runtime_checkable
class Measured(Protocol):
    """Dynamics that say their units; a dataclass may have them as plain attributes."""

    @property
    def state_units(self) -> tuple[str, ...]:
        """Of each state, such as "m" or "rad"."""

    @property
    def input_units(self) -> tuple[str, ...]:
        """Of each input, such as "m/s²"."""


class Units(NamedTuple):
    """By name; "" where a dynamics does not say."""

    states: dict[str, str]
    inputs: dict[str, str]


def units(dynamics: Dynamics) -> Units:
    """The units of a dynamics' states and inputs."""
    if not isinstance(dynamics, Measured):
        return Units(dict.fromkeys(dynamics.states, ""), dict.fromkeys(dynamics.inputs, ""))
    return Units(
        dict(zip(dynamics.states, dynamics.state_units, strict=True)),
        dict(zip(dynamics.inputs, dynamics.input_units, strict=True)),
    )
