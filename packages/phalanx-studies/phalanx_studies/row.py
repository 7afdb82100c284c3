"""A row of a study, what is kept of one run, and its identity.

The identity is all that a row was computed from, by digests that are kept apart. It has the meaning
of the scenario, not its text or file; not the engine, since both give the same bits; and not the
platform, which is a column of its own.
"""

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_type_hints

import msgspec
import phalanx_agent
import phalanx_plant
import polars as pl

import phalanx
import phalanx_studies
from phalanx.guarantee.verdict import Summary
from phalanx.recording.columns import Track
from phalanx.recording.metrics.table import METRICS, SWARM, metrics_of
from phalanx.recording.read import Recording
from phalanx.scenario.model import Scenario, digest
from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.origin import EMPTY
from phalanx_studies.plan import as_text

_LIBRARIES = ("numpy", "casadi", "osqp", "pydantic")
"""Those that may change a trajectory, or the scenario that is run."""
_LANGUAGES = {".py", ".c", ".h"}


class Identity(NamedTuple):
    """Digests of all that a row follows from; rows with equal keys are equal."""

    scenario: str
    """Of the scenario with all defaults, before its seed draws anything."""
    seed: int
    modules: str
    """Of the sources of the user's modules that the scenario imports, and the files of programs."""
    versions: str
    """Of Phalanx's sources, and the versions of the libraries that compute."""

    @property
    def key(self) -> str:
        """One digest of all, in hexadecimal."""
        return _digest(list(self))


def digest_of_scenario(scenario: Scenario) -> str:
    """Return the digest of a scenario, without what no run depends on."""
    return digest(scenario.model_copy(update={"seed": 0, "description": "", "attack": None}))


def digest_of_modules(sources: Mapping[str, bytes]) -> str:
    """Return the digest of sources by path."""
    return _digest({path: hashlib.sha256(text).hexdigest() for path, text in sources.items()})


@cache
def versions() -> str:
    """Return one digest of Phalanx's sources and the versions of the libraries that compute."""
    sources: dict[str, str] = {}
    for package in (phalanx, phalanx_agent, phalanx_plant, phalanx_studies):
        folder = Path(package.__path__[0])
        for file in sorted(f for f in folder.rglob("*") if f.suffix in _LANGUAGES):
            name = f"{package.__name__}/{file.relative_to(folder).as_posix()}"
            sources[name] = hashlib.sha256(file.read_bytes()).hexdigest()
    return _digest([{name: version(name) for name in _LIBRARIES}, sources])


def _digest(value: Any) -> str:
    text = json.dumps(value, sort_keys=True).encode()
    return hashlib.blake2b(text, digest_size=12).hexdigest()


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
    """Largest h of a pair with a normal agent."""
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
    engine: str = ""
    """The engine that made it, of those with the same bits."""
    wall_time: float = 0.0
    """[s]"""
    platform: str = platform.platform()
    searched: bool = False
    """True if the run was chosen by a search: such rows never enter an interval."""
    robustness: str = ""
    """Of each pair, as JSON by label, in a run of a search."""


def row_of(
    identity: Identity, overrides: dict[str, Any], summary: Summary, run: Recording | Track,
    swarm: Swarm, engine: str = "in-process",
) -> Row:  # fmt: skip
    """Return the row of a run that went to its verdict. Raises MistakenMethodError."""
    certificates = summary.certificates
    return Row(
        identity=identity,
        overrides=overrides,
        outcome=summary.outcome,
        reason=summary.reason,
        t=summary.t,
        worst_h=summary.worst_h,
        worst_at=summary.worst_at,
        worst_pair=summary.worst_pair,
        first_violation=min((violation.first for violation in summary.violations), default=None),
        certified=certificates.certified / certificates.samples if certificates.samples else None,
        shortest=certificates.shortest,
        uncovered_at=certificates.uncovered_at,
        empty=sum(summary.origins.get(origin, 0) for origin in EMPTY),
        faults=", ".join(fault.name for fault in summary.faults if fault.count),
        metrics=metrics_of(run, swarm)[SWARM],
        trajectory=summary.trajectory,
        engine=engine,
        wall_time=summary.wall_time,
    )


def flat(row: Row) -> dict[str, Any]:
    """Return a row by the columns of SCHEMA."""
    columns = msgspec.structs.asdict(row)
    metrics, overrides = columns.pop("metrics"), json_text(row.overrides)
    columns = {**columns, **row.identity._asdict(), "key": row.identity.key, "overrides": overrides}
    return {name: columns[name] if name in columns else metrics.get(name) for name in SCHEMA}


def row_from(columns: dict[str, Any]) -> Row:
    """Invert flat, but for the metrics."""
    fields = {name: columns[name] for name in get_type_hints(Row) if name in columns}
    identity = Identity(*(columns[name] for name in Identity._fields))
    overrides = msgspec.json.decode(columns["overrides"])
    return Row(**{**fields, "identity": identity, "overrides": overrides})


def _schema() -> dict[str, Any]:
    """Return the type of each column: the identity, the fields of a row, and the metrics."""
    types: dict[Any, Any] = {str: pl.String, int: pl.Int64, float: pl.Float64, bool: pl.Boolean}
    fields = {**get_type_hints(Identity), **get_type_hints(Row)}
    of_fields = {
        name: types[next(part for part in (hint, *get_args(hint)) if part in types)]
        for name, hint in fields.items()
        if name not in ("identity", "overrides", "metrics")
    }
    of_metrics = {name: pl.Boolean if name == "arrived" else pl.Float64 for name in METRICS}
    return {"key": pl.String, "overrides": pl.String, **of_fields, **of_metrics}


SCHEMA = _schema()
"""Column types by name; each has null where a run has no value."""


def fields_of(rows: pl.DataFrame) -> pl.DataFrame:
    """Return a column for each field that overrides set; lists and tables as JSON."""
    tables = [msgspec.json.decode(text) for text in rows["overrides"]]
    paths = dict.fromkeys(path for table in tables for path in table)
    # `faults` are also those of a row that had an effect.
    names = {path: f"{path}_set" if path in SCHEMA else path for path in paths}
    values = {name: [as_text(table.get(path)) for table in tables] for path, name in names.items()}
    return pl.DataFrame(values, strict=False)


def json_text(value: Any) -> str:
    """Return a value as JSON, equal for equal values."""
    return msgspec.json.encode(value, order="sorted").decode()


def without_effect(runs: pl.DataFrame, axes: Sequence[str]) -> Iterator[str]:
    """Name the axes of which no value gives a run another trajectory, all else being equal."""
    ran = runs.filter(pl.col("trajectory") != "")
    for axis in axes:
        others = ["seed", *(other for other in axes if other != axis)]
        counts = ran.group_by(others).agg(pl.col("trajectory", axis).n_unique())
        if counts.filter(pl.col(axis) > 1)["trajectory"].max() == 1:
            yield f"{axis} changes no trajectory: runs that differ in it alone are the same"


def counted(frame: pl.DataFrame) -> pl.DataFrame:
    """Return the runs that enter an interval: neither chosen by a search nor refused."""
    return frame.filter(~pl.col("searched") & (pl.col("outcome") != REFUSED)).sort("index")
