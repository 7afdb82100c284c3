"""Make every agent's decisions of a run in real time again, each from what the agent was shown.

The wall clock does not come back, so the run is not run again. What each agent made of a sample and
of the inputs that it had received is a function of both, whatever the clock: that is compared.
"""

import msgspec
import numpy as np

from phalanx.agent.step import ControlStep, control_steps
from phalanx.faults.state import Orders
from phalanx.network.claim import Claim
from phalanx.recording.read import Recording
from phalanx.recording.records import Shown, Step
from phalanx.swarm.rows import build_rows
from phalanx.swarm.seen import SeenStates
from phalanx.swarm.swarm import build_swarm


def decided_again(recorded: Recording) -> Recording:
    """The recording with every step as it is decided now; what was not shown stays as it is."""
    swarm = build_swarm(recorded.scenario)
    rows, states = build_rows(swarm), SeenStates(swarm)
    steps = {s.name: s for name in recorded.scenario.programs() for s in control_steps(rows, name)}
    found = {(step.agent, step.k): place for place, step in enumerate(recorded.steps)}
    again = list(recorded.steps)
    for shown in recorded.shown:
        place = found.get((shown.agent, shown.k))
        if place is not None:
            again[place] = _decided(steps[shown.agent], shown, again[place], states)
    return Recording(recorded.path, recorded.scenario, recorded.metadata, recorded.states, again)


def _decided(step: ControlStep, shown: Shown, recorded: Step, states: SeenStates) -> Step:
    if shown.adversary:
        step.obey(Orders(adversary=True))
    names = step.swarm.names
    seen = tuple(map(names.index, shown.seen))
    x = states.stacked(states.of(np.array(shown.x, dtype="<f8").tobytes(), seen))
    received = {names.index(sender): Claim(since, tuple(u)) for sender, since, u in shown.received}
    result = step.decide(x, seen, shown.t, received)
    return msgspec.structs.replace(
        recorded,
        u=tuple(result.decision.u.tolist()),
        ages=[(names[l], shown.t - received[l].t_apply) for l in result.used],
        **msgspec.structs.asdict(result.report(recorded.solve_time)),
    )
