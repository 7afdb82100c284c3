"""Early warnings: when an agent of the paper's filter lost its last fallback, in shipped attacks.

    python -m evidence.promise.warning

The runs are those of the attack files, in which no agent keeps a fallback. At each recorded state a
flight *exists* if from there some way out, begun at once, is clear of all adversaries for ever.
"""

import numpy as np

from phalanx.launcher.simulation import RecordsInMemory, Simulation
from phalanx.promise.exit import Chasers
from phalanx.recording.records import State
from phalanx.scenario.load import load
from phalanx.swarm.committed import flights_of, reach_of
from phalanx.swarm.runnable import shared_rows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.safety.function import Separation

ATTACKS = "attacks/paper-margin", "attacks/paper-margin-two"


def main() -> None:
    """Print the table."""
    heads = "attack", "last flight", "last certificates", "unsafe from"
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for name in ATTACKS:
        rows, records = shared_rows(load(name)), RecordsInMemory()
        summary = Simulation(rows, records).run()
        states = [(state.t, np.asarray(state.x)) for state in records.of(State)]
        swarm, first = rows.swarm, min(summary.violations, key=lambda v: v.first)
        i = next(i for i in swarm.normal if swarm.names[i] in first.pair.split("-"))
        flights = max(t for t, x in states if t < first.first and can_flee(swarm, i, x))
        certificates, unsafe = summary.certificates.uncovered_at, first.first
        print(f"| `{name}` | {flights:.3f} s | {certificates:.3f} s | {unsafe:.3f} s |", flush=True)


def can_flee(swarm: Swarm, i: int, x: Array) -> bool:
    """Return whether agent i has a way out at a state, shape (n̄,)."""
    parts, function = swarm.safe_set.parts, swarm.safety.safe_set_function
    assert isinstance(function, Separation)
    flights = flights_of(swarm, i)
    others = [l for l, member in enumerate(swarm.members) if member.adversary]
    speeds = [reach_of(swarm, l).for_ever(x[parts[l]])[1] for l in others]
    nothing = np.zeros(len(others))
    chasers = Chasers(swarm.positions(x)[others], nothing, np.array(speeds), nothing)
    state = x[parts[i]]
    gaps = [
        flights.gaps(state, flights.input(state, way), way, chasers).min()
        for way in flights.ways(state)
    ]
    return bool(max(gaps) >= function.radius)


if __name__ == "__main__":
    main()
