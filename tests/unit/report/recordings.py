"""Recordings to report on: swarms that drift, with inputs and links as their rules make them."""

from collections.abc import Mapping
from pathlib import Path

import casadi as ca
import numpy as np

from phalanx.guarantee.verdict import Assumption, CertificateSummary, Outcome, Summary, Violation
from phalanx.network.link import Link
from phalanx.recording.records import RECORDING, Log, State, Step
from phalanx.recording.write import RecordingWriter
from phalanx.scenario.load import load, validate
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.origin import Origin
from tests.unit.tables import group, swarm_table

HOSTILE = "<script>alert('&')</script>"
"""A text that every field of a recording might hold."""


def drift(scenario: Scenario, states: int = 60, steps: int = 40) -> list[State | Step | Log]:
    """Records of a swarm that drifts along x; inputs and links as real as their rules make them."""
    swarm = build_swarm(scenario)
    composed = swarm.safe_set
    outputs = [composed.substitute(composed.h_tot), ca.mmax(composed.h)]
    highest = ca.Function("h", [composed.x], outputs)
    along = np.concatenate([np.eye(len(m.dynamics.states))[0] for m in swarm.members])
    records: list[State | Step | Log] = []
    for t in np.linspace(0.0, scenario.duration, states):
        x = swarm.start() + t * along
        records.append(State(float(t), x.tolist(), *map(float, highest(x))))
    for k in range(steps):
        records += [step(scenario, swarm.names, i, k) for i in range(len(swarm.members))]
    return records


def step(scenario: Scenario, names: tuple[str, ...], i: int, k: int) -> Step:
    """Step k: normal agents' K_i is empty in every fifth, without authority in every tenth.

    Certified for 0, 0.5, ..., 4.5 τ in turn.
    """
    group = {name: group for name, group, _ in scenario.roster()}
    t, normal = 0.01 * k, group[names[i]].role == "normal"
    others = [n for n in names if normal and n != names[i] and group[n].role == "normal"]
    origin = Origin.QP if k % 5 else Origin.NO_AUTHORITY if k % 10 else Origin.BACKUP
    fates = []
    for sender in others:
        delay = fate(scenario, sender, names[i], k)
        fates.append((sender, k, -1.0 if delay is None else delay))
    return Step(
        agent=names[i],
        k=k,
        t=t,
        t_apply=t,
        u=(0.1,) * len(group[names[i]].dynamics_object().inputs),
        origin=origin if normal else Origin.ATTACK,
        residual=0.0,
        solve_time=1e-4 * (1 + k % 7),
        ages=[(name, 0.002 * (k % 4)) for name in others if k],
        fates=fates,
        certified=0.012 * (k % 10) / 2 if normal else None,
    )


def fate(scenario: Scenario, sender: str, receiver: str, k: int) -> float | None:
    model = scenario.links().model(sender, receiver)
    return Link(scenario.seed, sender, receiver, model).fate(k, 0.01 * k).delay


def summary_of(scenario: Scenario, reason: str = "h <= 0 throughout") -> Summary:
    return Summary(
        outcome=Outcome.VIOLATED,
        reason=reason,
        t=scenario.duration,
        seed=scenario.seed,
        trajectory="ab" * 32,
        worst_h=0.25,
        worst_at=0.3,
        worst_pair="1-4",
        largest_h_tot=0.26,
        largest_h_tot_at=0.31,
        steps=200,
        origins={"qp": 96, "backup": 12, "no-authority": 12},
        assumptions=[Assumption("certificates", 3, 120, 0.2, "every pair was under one")],
        theorem=[Assumption("non-empty K_i", 24, 120, 0.05, "a row had a solution")],
        certificates=CertificateSummary(120, 117, 0.5, "1-4", 0.2),
        violations=[Violation("1-4", 0.2, 0.25, 0.3, 0.15, 1, 0.2, 0.35)],
        rejected={f"stale {HOSTILE}": 7},
        wall_time=0.5,
    )


def record(
    folder: Path, scenario: Scenario, records: list[State | Step | Log], summary: Summary | None
) -> Path:
    with RecordingWriter(folder / RECORDING, scenario, "test-1") as writer:
        for entry in records:
            writer.write(entry)
        if summary:
            writer.finish(summary)
    return folder


def unicycles(*overrides: str) -> Scenario:
    return load("unicycles", ["duration=0.6", *overrides])


def swarm_in_space(normal: int, adversaries: int, extra: Mapping[str, object]) -> Scenario:
    """Single integrators, three-dimensional, on a line."""
    rows = ("normal", "track-velocity", normal, 0.0), ("adversary", "pursue", adversaries, 9.0)
    groups = [
        group(
            " ".join(f"{role[0]}{i}" for i in range(count)),
            role,
            [[3.0 * i, y, 0.5 * i] for i in range(count)],
            law={"type": law, "gain": 1.0},
            dynamics={"type": "single-integrator", "speed": 1.0, "dimension": 3},
        )
        for role, law, count, y in rows
        if count
    ]
    table = swarm_table(*groups, safety={"alpha": [2.0], "eta": 1.0}, name="space", duration=0.6)
    return validate(table | dict(extra), "test")
