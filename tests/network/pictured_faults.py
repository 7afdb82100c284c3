"""Every fault that the pictures of docs/network-faults.md show, and the swarm that meets it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from phalanx.network.presets import PRESETS
from phalanx.network.rule import DELIVER, DROP, Message, Treatment

SWARM = "faults/lie-input"
"""Three agents, each of which wants to be beyond the two others; its own lie is taken out."""
CLOSE = [[-0.8, 0.0], [0.4, -0.693], [0.4, 0.693]]
APART = [[1.5 * x, 1.5 * y] for x, y in CLOSE]
"""Where they start [m]."""
DURATION = 1.5
"""[s]"""
TRACE = Path(__file__).parents[2] / "scenarios" / "faults" / "trace.csv"
AGENT, PEER = "2", "1"
"""The agent that has the fault, and a peer of it."""
JITTER = {"time": 0.02, "jitter": 0.01}

Overrides = Mapping[str, Any]
NOTHING: Overrides = {}


class Gallery(NamedTuple):
    """The faults of one picture."""

    faults: Mapping[str, Overrides]
    without: Overrides = NOTHING
    """What the scenario is that every fault is compared with, with none of them."""
    start: list[list[float]] = CLOSE

    def calm(self, name: str) -> Overrides:
        """The scenario without this fault."""
        return {**self.without, **ALONGSIDE.get(name, NOTHING)}


@dataclass(frozen=True)
class Rain:
    """The rule of the page: the farther apart, the more is lost."""

    per_metre: float

    def treat(self, message: Message) -> Treatment:
        """Drop it or not."""
        return DROP if message.draw("rain") < self.per_metre * message.distance else DELIVER


def _timed(begin: float, span: float | None, kind: str, **fields: Any) -> Overrides:
    """A fault from a time on, for a while or for good."""
    lasts = {} if span is None else {"for": span}
    return {"faults": [{"kind": kind, "at": begin, **lasts, **fields}]}


def _during(kind: str, **fields: Any) -> Overrides:
    """A fault of links, for half a second."""
    return _timed(0.5, 0.5, kind, **fields)


def _of_agent(kind: str, span: float | None = 0.5, **fields: Any) -> Overrides:
    """A fault of one agent, as it drives at the others."""
    return _timed(0.2, span, kind, agents=[AGENT], **fields)


ATTACK = _timed(0.3, None, "turn", agents=[AGENT])


def _lie(**fields: Any) -> Overrides:
    """A lie from the start on of an agent that attacks as well."""
    lie = {"kind": "lie", "agent": AGENT, "for": 2.0 * DURATION, **fields}
    return {"faults": [*ATTACK["faults"], lie]}


LINKS: Mapping[str, Overrides] = {
    "loss = 0.3": {"network.loss": 0.3},
    "loss = { mean = 0.3, burst = 12 }": {"network.loss": {"mean": 0.3, "burst": 12.0}},
    "loss_by_distance": {"network.loss_by_distance": {"none_within": 1.2, "all_beyond": 1.8}},
    "duplicate = 0.5": {"network.delay": {"low": 0.0, "high": 0.02}, "network.duplicate": 0.5},
    "corrupt = 0.3": {"network.corrupt": 0.3},
    "trace": {"network.trace": str(TRACE)},
    "rate": {"network.rate": {"bits_per_second": 9e4, "limit": 8}},
    "delay = 0.02": {"network.delay": 0.02},
    "delay = { low, high }": {"network.delay": {"low": 0.0, "high": 0.02}},
    "delay, normal": {"network.delay": {**JITTER, "distribution": "normal"}},
    "delay, pareto, correlation = 0.9": {
        "network.delay": {**JITTER, "distribution": "pareto", "correlation": 0.9}
    },
    "reorder": {"network.delay": 0.02, "network.reorder": {"probability": 0.3}},
    "delay_floor": {"network.delay_floor": {"per_metre": 0.008}},
    "slot = 0.1": {"network.slot": 0.1},
    "rules (Rain)": {"network.rules": [{"type": f"{__name__}:Rain", "per_metre": 0.2}]},
}
ALONGSIDE: Mapping[str, Overrides] = {
    name: {"network.delay": LINKS[name]["network.delay"]} for name in ("duplicate = 0.5", "reorder")
}
"""What goes wrong without the fault too: without a delay it would do nothing."""
TIMES: Mapping[str, Overrides] = {
    "partition, groups": _during("partition", groups=[[AGENT]]),
    'partition, shape = "majority"': _during("partition", shape="majority"),
    'partition, shape = "ring"': _during("partition", shape="ring"),
    'partition, shape = "isolate"': _during("partition", shape="isolate"),
    "hold": _during("hold"),
    "link, delay = 0.1": _during("link", delay=0.1),
    "link, loss = 0.5": _during("link", loss=0.5),
}
ROBOT: Mapping[str, Overrides] = {
    "sample.loss = 0.5": {"network.sample.loss": 0.5},
    "sample.corrupt = 0.3": {"network.sample.corrupt": 0.3},
    "actuation.loss = 0.5": {"network.actuation.loss": 0.5},
    "actuation.delay = 0.01": {"network.actuation.delay": 0.01},
}
LIES: Mapping[str, Overrides] = {
    'says = "opposite"': _lie(says="opposite"),
    'says = "zero"': _lie(says="zero"),
    "equivocate = true": _lie(equivocate=True),
    "replay = 20": _lie(replay=20),
    "apply_time = 0.005": _lie(apply_time=0.005),
    "silent = true": _lie(silent=True),
}
AGENTS: Mapping[str, Overrides] = {
    "kill": _of_agent("kill", None),
    "restart": _of_agent("restart"),
    "pause": _of_agent("pause"),
    "pause, rate = 4.0": {"faults": [{"kind": "pause", "rate": 4.0, "for": 0.1}]},
    "turn": _of_agent("turn", None),
    "hijack": _of_agent("hijack", None),
    "clock, step = 0.2": _of_agent("clock", None, step=0.2),
    "clock, skew = 0.2": _of_agent("clock", skew=0.2),
    "clock, drift = 2.0": _of_agent("clock", drift=2.0),
    "sensor, silent = true": _of_agent("sensor", silent=True),
    "sensor, bias = { x = 0.3, y = -0.6 }": _of_agent("sensor", bias={"x": 0.3, "y": -0.6}),
    "sensor, noise = { x = 0.3, y = 0.3 }": _of_agent("sensor", noise={"x": 0.3, "y": 0.3}),
    "actuator": _of_agent("actuator"),
}
GALLERIES: Mapping[str, Gallery] = {
    "links": Gallery(LINKS),
    "robot": Gallery(ROBOT),
    "presets": Gallery({f'preset = "{name}"': {"network.preset": name} for name in PRESETS}),
    "times": Gallery(TIMES),
    "lies": Gallery(LIES, without=ATTACK, start=APART),
    "agents": Gallery(AGENTS, start=APART),
}
