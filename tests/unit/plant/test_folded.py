"""Events that are judged at once are judged as one by one: the columns of a batch are no other."""

import msgspec
import numpy as np
import pytest
from msgspec.structs import asdict
from phalanx_plant.judge.judge import Judge, Judged
from phalanx_plant.world.events import Event, StateReached
from phalanx_plant.world.world import World

from phalanx.launcher.simulation import RecordsInMemory, Simulation
from phalanx.swarm.rows import SafetyRows
from tests.unit.swarms import rows_of_scenario

SCENARIOS = {
    # With agents that lie, stop and turn, inputs that come late, and a start that is unsafe.
    "unicycles": (
        "duration=0.3",
        "time.latency=0.004",
        "agents.0.start=[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 9.0, 0.0]]",
        'faults=[{kind="lie", agent="2", says="opposite", for=0.2}, '
        '{kind="pause", agents=["1"], at=0.1, for=0.1}, {kind="turn", agents=["3"], at=0.2}]',
    ),
    "stale-inputs": ("duration=0.6",),
    "crossing": ("duration=0.6",),
    "radio": ("duration=0.3",),
}


def happened(rows: SafetyRows) -> list[Event]:
    """Return the events of a run."""
    run, events = Simulation(rows, RecordsInMemory()), list[Event]()
    judge = run.plant.judge.judge

    def listen(batch: list[Event], judged: list[Judged]) -> None:
        events.extend(batch)
        judge(batch, judged)

    run.plant.judge.judge = listen
    run.run()
    return events


def judged_by(
    rows: SafetyRows, events: list[Event], sizes: list[int]
) -> tuple[bytes, list[Judged]]:
    """Return what is found of events that are judged so many at once, and all judgements."""
    judge, judged = Judge(rows), list[Judged]()
    world = World(rows)
    judge.begin(StateReached(0.0, world.x, world.take_history()))
    ends = np.cumsum([0, *sizes])
    for begin, end in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        judge.judge(events[begin:end], judged)
    found = asdict(judge.findings()) | {"least": judge.coverage.least.tolist()}
    return msgspec.json.encode(found | {"faults": dict(judge.claims.faults)}), judged


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_batch_of_events_has_the_verdict_of_each_alone(name, rng):
    rows = rows_of_scenario(name, *SCENARIOS[name])
    events = happened(rows)
    alone = judged_by(rows, events, [1] * len(events))
    sizes = rng.integers(1, 60, len(events))
    some = [*sizes[: int(np.searchsorted(np.cumsum(sizes), len(events)))].tolist()]
    for batches in ([len(events)], [*some, len(events) - sum(some)]):
        found, judged = judged_by(rows, events, batches)
        assert found == alone[0]
        assert judged == alone[1]
