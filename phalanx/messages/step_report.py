"""The numbers of a control step, each declared once.

A number is a field whose `Quantity` describes its plot. Telemetry, frames, recordings, the table of
inputs, plots, ROS 2 diagnostics and exports follow from the fields. To add a number, add a field
and the code that computes it.
"""

from collections.abc import Callable
from operator import attrgetter
from typing import Annotated, NamedTuple, get_type_hints

import msgspec

from phalanx.theory.rows.origin import Origin

OF_ROW = "ψ_q"
"""In place of a unit: the unit of an agent's row, which follows from the scenario's h."""


class Quantity(NamedTuple):
    """The plot of a number of a control step."""

    title: str
    unit: str = ""
    safe: tuple[float | None, float | None] = (None, None)
    """Least and largest safe value, as plotted."""
    in_horizons: bool = False
    """Plotted in multiples of τ, on a logarithmic axis."""


class StepReport(msgspec.Struct, array_like=True, forbid_unknown_fields=True, kw_only=True):
    """An agent's report of a control step."""

    origin: Origin
    residual: Annotated[float | None, Quantity("Residual of the row", OF_ROW, safe=(None, 0.0))]
    """aᵀu - bound of its row; 0 for an adversary, null where no margin is known, and for a
    controller without rows."""
    margin: Annotated[float | None, Quantity("Margin of the row", OF_ROW)] = None
    """η with all that its row adds to it; null for an adversary, where none of several rows binds
    anything, and where none is known."""
    proven: Annotated[
        float | None, Quantity("Proven by the agent for", "s", safe=(1.0, None), in_horizons=True)
    ] = None
    """With safety.prove, for how long the agent itself has proven its pairs in sight safe [s]; null
    for an adversary, and without it."""
    u_nom: tuple[float, ...] = ()
    """The nominal input, or the attack before its projection onto U_i, shape (m_i,)."""
    solve_time: Annotated[float, Quantity("Control step", "s")]
    """Wall time from sample to input [s]; not part of the trajectory."""
    binding: tuple[int, ...] = ()
    """Whose rows the input is at the bound of: members, N + k for obstacle k, then limits."""


class AppliedStep(StepReport, kw_only=True):
    """A control step whose input took effect: the agent's report and the plant's numbers."""

    u: tuple[float, ...]
    """Native input, shape (m_i,)."""
    oldest_input: Annotated[float | None, Quantity("Age of the oldest received input", "s")] = None
    """Age of the oldest û_l that its row used [s]; null if it used none."""
    certified: Annotated[
        float | None, Quantity("Certified for", "s", safe=(1.0, None), in_horizons=True)
    ] = None
    """For how long all pairs of a normal agent are proven safe once the input is applied [s]; null
    for an adversary."""


def _quantities(kind: type[msgspec.Struct]) -> dict[str, Quantity]:
    """The numbers among a struct's fields, by name."""
    hints = get_type_hints(kind, include_extras=True)
    metadata = {name: getattr(hints[name], "__metadata__", ()) for name in kind.__struct_fields__}
    return {name: q for name, found in metadata.items() for q in found if isinstance(q, Quantity)}


QUANTITIES = _quantities(AppliedStep)
numbers_of: Callable[[AppliedStep], tuple[float | None, ...]] = attrgetter(*QUANTITIES)
"""The numbers of a step, in the order of QUANTITIES."""
