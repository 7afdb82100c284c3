"""A row of a study: what is kept of one run."""

import platform
from typing import Any

import msgspec

from phalanx.guarantee.verdict import Summary
from phalanx.metrics.table import METRICS, SWARM, metrics_of
from phalanx.recording.read import Recording
from phalanx.studies.identity import Identity
from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.origin import Origin

REFUSED = "refused"
"""The outcome of a run that could not begin: its scenario is not valid."""
BROKEN = "broken"


class Row(msgspec.Struct, kw_only=True):
    """The result of one run; None where it has no meaning, or there was no run."""

    identity: Identity
    overrides: dict[str, Any]
    outcome: str
    """The run's verdict, or "refused"."""
    reason: str
    t: float | None = None
    """Virtual time reached [s]."""
    worst_h: float | None = None
    """Largest h_tot."""
    worst_at: float | None = None
    """[s]"""
    worst_pair: str = ""
    first_violation: float | None = None
    """Time at which the first pair left the safe set [s]."""
    certified: float | None = None
    """Share of the normal agents' inputs that were certified until the next sample."""
    shortest: float | None = None
    """The shortest time for which an input was certified, in multiples of τ."""
    uncovered_at: float | None = None
    """Time from which the first pair had no certificate [s]."""
    empty: int | None = None
    """Steps of normal agents at which K_i was empty."""
    faults: str = ""
    """The declared faults that had an effect."""
    metrics: dict[str, float | bool | None] = {}
    """Of the swarm, by name."""
    trajectory: str = ""
    """Hash of the trajectory."""
    wall_time: float = 0.0
    """[s]"""
    platform: str = platform.platform()
    confirmed: bool | None = None
    """Whether the run as processes had the same trajectory; None if it was not run so."""
    searched: bool = False
    """True if the run was chosen by a search: such rows never enter an interval."""


def row_of(
    identity: Identity, overrides: dict[str, Any], summary: Summary, recording: Recording,
    swarm: Swarm,
) -> Row:  # fmt: skip
    """Return the row of a run that went to its verdict. Raises MistakenMethodError."""
    found = summary.certificates
    return Row(
        identity=identity,
        overrides=overrides,
        outcome=summary.outcome,
        reason=summary.reason,
        t=summary.t,
        worst_h=summary.worst_h_tot,
        worst_at=summary.worst_at,
        worst_pair=summary.worst_pair,
        first_violation=min((each.first for each in summary.violations), default=None),
        certified=found.certified / found.samples if found.samples else None,
        shortest=found.shortest,
        uncovered_at=found.uncovered_at,
        empty=summary.origins.get(Origin.BACKUP, 0) + summary.origins.get(Origin.NO_AUTHORITY, 0),
        faults=", ".join(fault.name for fault in summary.faults if fault.count),
        metrics=metrics_of(recording, swarm)[SWARM],
        trajectory=summary.trajectory,
        wall_time=summary.wall_time,
    )


def flat(row: Row) -> dict[str, Any]:
    """Return a row as columns: each metric has one, and each digest of the identity."""
    found = msgspec.structs.asdict(row)
    metrics, identity = found.pop("metrics"), found.pop("identity")
    of_metrics = {name: metrics.get(name) for name in METRICS}
    return {**found, **of_metrics, **identity._asdict(), "key": identity.key}
