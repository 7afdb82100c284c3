"""scenarios/faults: each fault has its effect, which is gone without it, and its count."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

import phalanx
from phalanx.network.table import Network

AT, OVER = 0.4, 0.7
"""Of the faults of a time [s]."""


def calmed(scenario: phalanx.Scenario) -> phalanx.Scenario:
    """The same scenario, and nothing goes wrong."""
    nothing = {"network": Network(), "faults": ()}
    unnamed = {"name": "calm", "description": "", "reading": None}
    return scenario.model_copy(update=nothing | unnamed)


def names() -> list[str]:
    """Return the scenarios of faults; those of lies have their own tests."""
    faults = [name for name in phalanx.shipped() if name.startswith("faults/")]
    return [name for name in faults if not name.startswith("faults/lie-")]


def samples(run: phalanx.Run, agent: str) -> np.ndarray:
    """Return the times of the agent's samples [s]."""
    return run.inputs.filter(agent=agent)["t"].to_numpy()


def longest_gap(run: phalanx.Run, agent: str) -> float:
    return float(np.diff(samples(run, agent)).max())


def silent(run: phalanx.Run, agent: str, begin: float, end: float) -> bool:
    """Return whether the agent took no sample in this time [s]."""
    return not any(begin <= t < end for t in samples(run, agent))


def delays(run: phalanx.Run) -> Iterator[float]:
    """Return the delays of all broadcasts; nan: lost [s]."""
    return (np.nan if delay is None else delay for delay in run.links["delay"])


def lost(run: phalanx.Run) -> float:
    return float(np.mean([np.isnan(delay) for delay in delays(run)]))


def slow(run: phalanx.Run) -> float:
    return float(np.mean([delay > 0.0 for delay in delays(run)]))


def longest_run_of_losses(run: phalanx.Run) -> int:
    longest = 0
    for _, link in run.links.group_by("sender", "receiver", maintain_order=True):
        in_a_row = 0
        for delay in link.sort("k")["delay"]:
            in_a_row = in_a_row + 1 if delay is None else 0
            longest = max(longest, in_a_row)
    return longest


def overtaken(run: phalanx.Run) -> bool:
    """Return whether a broadcast arrived before one that was sent earlier."""
    return any(
        (np.diff([k for _, k in sorted(arrivals)]) < 0).any()
        for _, link in run.links.filter(~run.links["delay"].is_null()).group_by(
            "sender", "receiver"
        )
        for arrivals in [[(0.02 * k + delay, k) for k, delay in link[["k", "delay"]].rows()]]
    )


def in_slots(run: phalanx.Run) -> bool:
    """Return whether every broadcast arrived at a multiple of 50 ms."""
    inputs = run.inputs.select("k", "t_apply", sender="agent")
    came = run.links.filter(~run.links["lost"]).join(inputs, on=["sender", "k"])
    slots = (came["t_apply"] + came["delay"]).to_numpy() / 0.05
    return np.allclose(slots, np.round(slots), atol=1e-9)


def failed(run: phalanx.Run, name: str) -> int:
    summary = run.summary
    found = {a.name: a.failed for a in [*summary.theorem, *summary.assumptions]}
    return found.get(name, 0)


def logged(run: phalanx.Run, text: str) -> bool:
    return any(text in line for line in run.events["text"])


EFFECTS: dict[str, Callable[[phalanx.Run], bool]] = {
    "actuator": lambda run: failed(run, "inputs in time") == 10,
    "at-random": lambda run: failed(run, "sampling gap") > 4,
    "burst": lambda run: longest_run_of_losses(run) >= 5,
    "clock": lambda run: longest_gap(run, "1") > 0.06 and longest_gap(run, "2") > 0.024,
    "corrupt": lambda run: sum(run.summary.rejected.values()) > 20,
    "delay": lambda run: slow(run) > 0.9,
    "distance": lambda run: 0.0 < lost(run) < 1.0 and slow(run) > 0.5,
    "duplicate": lambda run: sum(fault.count for fault in run.summary.faults) > 20,
    "hijack": lambda run: logged(run, "1 hijacked") and failed(run, "truthful broadcasts") > 20,
    "hold": lambda run: slow(run) > 0.2,
    "kill": lambda run: silent(run, "1", AT, 1.0) and logged(run, "1 killed; lost with it: the"),
    "link": lambda run: lost(run) > 0.0 and slow(run) > 0.0,
    "loss": lambda run: 0.25 < lost(run) < 0.45,
    "partition": lambda run: lost(run) > 0.1,
    "pause": lambda run: silent(run, "1", AT, OVER) and OVER in samples(run, "1"),
    "rate": lambda run: lost(run) > 0.0 and slow(run) > 0.2,
    "reorder": overtaken,
    "restart": lambda run: silent(run, "1", AT, OVER) and logged(run, "1 restarted"),
    "robot": lambda run: failed(run, "sampling gap") > 5 and failed(run, "inputs in time") > 20,
    "sensor": lambda run: silent(run, "1", AT, 0.6) and failed(run, "truthful sensors") == 15,
    "slot": in_slots,
    "trace": lambda run: 0.1 < lost(run) < 0.3 and slow(run) > 0.05,
    "turn": lambda run: (
        [v.pair for v in run.summary.excluded] == ["1-4"] and logged(run, "1 turned adversary")
    ),
}


@pytest.fixture(scope="module")
def calm() -> phalanx.Run:
    return phalanx.run(calmed(phalanx.load(names()[0])), engine="in-process")


def test_every_fault_that_ships_is_looked_at() -> None:
    assert set(names()) == {f"faults/{name}" for name in EFFECTS}


@pytest.mark.parametrize("name", EFFECTS)
def test_a_fault_has_its_effect_and_its_count(name: str, calm: phalanx.Run) -> None:
    """Without it there is no effect."""
    scenario = phalanx.load(f"faults/{name}")
    assert calmed(scenario) == calm.scenario
    run = phalanx.run(scenario, engine="in-process")
    assert EFFECTS[name](run)
    assert not EFFECTS[name](calm)
    assert run.summary.faults
    assert run.summary.notes == []
