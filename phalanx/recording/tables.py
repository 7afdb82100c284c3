"""A recording as data frames with named columns.

Each begins with run, scenario and seed, so that tables of several runs can be concatenated.
"""

from collections.abc import Sequence

from phalanx.messages.step_report import QUANTITIES
from phalanx.recording.read import Recording
from phalanx.schema.extensions import extras_named
from phalanx.swarm.swarm import Swarm

with extras_named():
    import polars as pl


def states_table(recording: Recording, swarm: Swarm) -> pl.DataFrame:
    """Make a row for each event: t [s], h_tot, and every agent's states as "<agent>.<state>"."""
    names = [f"{m.name}.{state}" for m in swarm.members for state in m.dynamics.states]
    x = recording.x.reshape(len(recording.states), len(names))
    table = pl.DataFrame(
        {"t": recording.times, "h_tot": recording.h_tot}
        | {name: x[:, column] for column, name in enumerate(names)},
        schema=dict.fromkeys(("t", "h_tot", *names), pl.Float64),
    )
    return of_run(recording, table)


def h_table(recording: Recording, swarm: Swarm) -> pl.DataFrame:
    """Make a row for each event: t [s], and every pair's h as "<agent>-<agent>"; safe is h <= 0."""
    h = swarm.h_of_pairs(recording.x)
    table = pl.DataFrame({"t": recording.times} | h, schema=dict.fromkeys(("t", *h), pl.Float64))
    return of_run(recording, table)


def inputs_table(recording: Recording, swarm: Swarm) -> pl.DataFrame:
    """Make a row for each control step of each agent.

    Columns: agent, k, t and t_apply [s], origin and the numbers of an AppliedStep, null where there
    is none; then the applied inputs "u.<input>" and those of the law "nominal.<input>", null where
    the agent's dynamics have no such input; and what a controller noted, "note.<name>".
    """
    names = list(dict.fromkeys(n for m in swarm.members for n in m.dynamics.inputs))
    inputs = {m.name: m.dynamics.inputs for m in swarm.members}
    steps = recording.steps
    columns: dict[str, Sequence[object]] = {
        "agent": [step.agent for step in steps],
        "k": [step.k for step in steps],
        "t": [step.t for step in steps],
        "t_apply": [step.t_apply for step in steps],
        "origin": [step.origin for step in steps],
    }
    for name in QUANTITIES:
        columns[name] = [getattr(step, name) for step in steps]
    for name in names:
        columns[f"u.{name}"] = [_component(s.u, inputs[s.agent], name) for s in steps]
    for name in names:
        columns[f"nominal.{name}"] = [_component(s.u_nom, inputs[s.agent], name) for s in steps]
    for name in sorted({name for step in steps for name in step.notes}):
        columns[f"note.{name}"] = [step.notes.get(name) for step in steps]
    kinds = {"agent": pl.String, "k": pl.Int64, "origin": pl.String}
    table = pl.DataFrame(columns, schema={c: kinds.get(c, pl.Float64) for c in columns})
    return of_run(recording, table)


def links_table(recording: Recording) -> pl.DataFrame:
    """Make a row for each broadcast whose fate a receiver decided.

    Columns: sender, receiver, k (the broadcast's number), t (time of the decision [s]), lost,
    delay [s], null if it was lost; faults, the names of declared faults that affected it; and
    lied, whether its claim was false.
    """
    rows = []
    for step in recording.steps:
        faults = {(sender, k): names for sender, k, names in step.faults}
        lied = {(sender, k) for sender, k, *_ in step.false}
        for sender, k, delay in step.fates:
            lost, key = delay < 0.0, (sender, k)
            of_arrival = None if lost else delay
            names = faults.get(key, [])
            rows.append((sender, step.agent, k, step.t, lost, of_arrival, names, key in lied))
    schema: dict[str, pl.DataType | type[pl.DataType]] = {
        "sender": pl.String,
        "receiver": pl.String,
        "k": pl.Int64,
        "t": pl.Float64,
        "lost": pl.Boolean,
        "delay": pl.Float64,
        "faults": pl.List(pl.String),
        "lied": pl.Boolean,
    }
    return of_run(recording, pl.DataFrame(rows, schema=schema, orient="row"))


def events_table(recording: Recording) -> pl.DataFrame:
    """Make a row for each line of the event log: t [s] and the text."""
    rows = [(line.t, line.text) for line in recording.log]
    table = pl.DataFrame(rows, schema={"t": pl.Float64, "text": pl.String}, orient="row")
    return of_run(recording, table)


def of_run(recording: Recording, table: pl.DataFrame) -> pl.DataFrame:
    """Put the columns run, scenario and seed before those of a table."""
    return table.select(
        pl.lit(recording.metadata.get("run", "")).alias("run"),
        pl.lit(recording.scenario.name).alias("scenario"),
        pl.lit(recording.scenario.seed, pl.Int64).alias("seed"),
        pl.all(),
    )


def _component(values: Sequence[float], names: Sequence[str], name: str) -> float | None:
    """Return the component of that name, or None if the agent has none."""
    return values[names.index(name)] if name in names and values else None
