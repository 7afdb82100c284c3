"""Strategies of hypothesis for networks, faults and starts; each value can be shrunk."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from phalanx.faults.fault import Fault
from phalanx_testing import fault_tables as of_kind

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

_GRID = 0.01
"""Times and positions are multiples of it, so that they read well when they are shrunk."""


def networks(
    *, most_loss: float = 0.9, most_delay: float = 0.2
) -> "SearchStrategy[dict[str, Any]]":
    """Draw fields of [network], to pass on as keywords: loss, delay [s], duplicate."""
    from hypothesis import strategies as st

    return st.fixed_dictionaries(
        {},
        optional={
            "loss": _multiples(most_loss),
            "delay": _multiples(most_delay),
            "duplicate": _multiples(0.5),
        },
    )


def faults(agents: Sequence[str], *, until: float) -> "SearchStrategy[list[Fault]]":
    """Draw up to three faults of these agents that begin and end before a time [s].

    Only faults that leave agents normal are drawn: partitions, bad links, pauses, restarts.
    """
    from hypothesis import strategies as st

    name = st.sampled_from(list(agents))
    times: dict[str, Any] = {
        "at": _multiples(0.5 * until), "for_": _multiples(0.5 * until, least=_GRID)
    }  # fmt: skip
    fault = st.one_of(
        st.builds(lambda alone, **t: of_kind.partition([alone], **t), name, **times),
        st.builds(of_kind.link, loss=_multiples(1.0), **times),
        st.builds(of_kind.pause, name, **times),
        st.builds(of_kind.restart, name, **times),
    )
    return st.lists(fault, max_size=3)


def starts(
    center: Sequence[Sequence[float]], *, spread: float
) -> "SearchStrategy[list[list[float]]]":
    """Draw starts of a group, for the field agents.<n>.start.

    Args:
        center: states of its agents in the middle of what is drawn.
        spread: most difference of each component.
    """
    from hypothesis import strategies as st

    def near(value: float) -> "SearchStrategy[float]":
        return _multiples(spread, least=-spread).map(lambda change: value + change)

    return st.tuples(*(st.tuples(*map(near, state)) for state in center)).map(
        lambda states: [list(state) for state in states]
    )


def _multiples(most: float, *, least: float = 0.0) -> "SearchStrategy[float]":
    """Draw multiples of the grid from the least to the most."""
    from hypothesis import strategies as st

    whole = st.integers(round(least / _GRID), round(most / _GRID))
    return whole.map(lambda n: round(n * _GRID, 6))
