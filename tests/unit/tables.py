"""Tables of small scenarios: agents that keep a distance, and what a test is about."""

from typing import Any

Table = dict[str, Any]
SPLIT = {"composition": "pairs", "margin": "integrated", "information": "split"}
"""Fields of safety: a row for each pair, of which agents keep halves."""


def group(
    names: str,
    role: str,
    start: list[list[float]],
    law: str | Table = "track-velocity",
    speed: float = 2.0,
    period: float = 0.01,
    **fields: Any,
) -> Table:
    """Return a group of points that can move in all directions.

    fields: others of its, or other tables in the place of these.
    """
    return {
        "names": names.split(),
        "role": role,
        "dynamics": {"type": "single-integrator", "speed": speed},
        "law": {"type": law} if isinstance(law, str) else law,
        "clock": {"period": period},
        "start": start,
    } | fields


def swarm_table(
    *agents: Table, function: str = "separation", radius: float = 1.0, safety: Table, **fields: Any
) -> Table:
    """Return a scenario of a second, in which agents keep a distance.

    safety: its other fields. fields: others of the scenario.
    """
    of_all = {"function": {"type": function, "radius": radius}, "rho": 5.0, "alpha": [1.0]}
    table = {"name": "points", "duration": 1.0, "safety": of_all | safety, "agents": [*agents]}
    return table | fields
