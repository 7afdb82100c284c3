"""Convictions of equivocation, and the bytes and CPU time of signed broadcasts.

python evidence/unknown/equivocations.py --seeds 100
"""

import argparse
import time
from collections.abc import Mapping

import numpy as np

import phalanx
from phalanx.launcher.in_process_engine import RecordsInMemory, simulate
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.wire.membership import Membership
from phalanx.wire.messages import Broadcast, SignedBroadcast
from phalanx.wire.signatures import Signatures

NETWORK = {"network.loss": {"mean": 0.3, "burst": 3.0}, "network.delay": 0.013}
LIES: Mapping[str, Mapping[str, object] | None] = {
    "another input to every peer": {"equivocate": True},
    "a lie to one, the truth to the other": {"says": "zero", "to": ["1"]},
    "none": None,
}
ROUNDS = 7


def main() -> None:
    """Print the three tables."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=100)
    seeds = arguments.parse_args().seeds
    print("| lie of agent 2 | runs | convicted by both peers | median delay [ms] | false |")
    print("|---|---|---|---|---|")
    for name, lie in LIES.items():
        convicted, delays, false = convictions(lie, seeds)
        delay = f"{1e3 * np.median(delays):.0f}" if delays else ""
        print(f"| {name} | {seeds} | {convicted} | {delay} | {false} |", flush=True)
    print("\n| broadcast | bytes |\n|---|---|")
    for name, size in sizes().items():
        print(f"| {name} | {size} |")
    print("\n| scenario | watch [µs] | with evidence [µs] | ratio |\n|---|---|---|---|")
    for scenario in ("unicycles", "swarm2d"):
        rounds = np.array(turns(scenario))
        watch, evidence = np.median(rounds, axis=0)
        ratio = np.median(rounds[:, 1] / rounds[:, 0])
        print(f"| {scenario} | {watch:.0f} | {evidence:.0f} | {ratio:.2f} |", flush=True)


def convictions(lie: Mapping[str, object] | None, seeds: int) -> tuple[int, list[float], int]:
    """Count runs in which both peers prove it; return delays [s] and all other convictions."""
    fault = {"kind": "lie", "agent": "2", "at": 0.2, "for": 9.0, **(lie or {})}
    changes = {"safety.evidence": True, "duration": 0.8, **NETWORK}
    changes |= {"faults": [fault]} if lie else {}
    convicted, delays, false = 0, list[float](), 0
    for seed in range(seeds):
        run = phalanx.run(phalanx.load("unicycles", changes, seed), engine="in-process")
        trust = run.summary.trust if run.summary else None
        assert trust is not None
        proven = [c for c in trust.convictions if c.number is not None]
        convicted += {(c.by, c.of) for c in proven} == {("1", "2"), ("3", "2")}
        delays += [c.after for c in proven if c.after is not None]
        false += trust.false
    return convicted, delays, false


def sizes() -> dict[str, int]:
    """Return the length of payloads of a unicycle [bytes]."""
    whole = Membership("run", "", b"secret")
    key, claim = whole.keys.broadcast("1", "2"), (120, 1.2, (0.5, -0.25))
    plain = Broadcast(k=claim[0], t_apply=claim[1], u=claim[2])
    signed = Signatures(whole, ("1", "2"), 0).sign(*claim)
    found = {"plain": len(whole.sealer.seal(key, plain))}
    for relayed, name in enumerate(("signed", "with a relayed claim", "with evidence")):
        message = SignedBroadcast(
            k=signed.k,
            t_apply=signed.t_apply,
            u=signed.u,
            signature=signed.signature,
            relayed=(signed,) * relayed,
        )
        found[name] = len(whole.sealer.seal(key, message))
    return found


def turns(scenario: str) -> list[list[float]]:
    """Return the CPU time of a run per control step in each round, without and with [µs]."""
    built = [
        build_rows(build_swarm(phalanx.load(scenario, {"duration": 1.0, field: True})))
        for field in ("safety.watch", "safety.evidence")
    ]
    found = []
    for _ in range(ROUNDS + 1):
        row = []
        for rows in built:
            begun = time.process_time()
            summary = simulate(rows, RecordsInMemory())
            row.append(1e6 * (time.process_time() - begun) / summary.steps)
        found.append(row)
    return found[1:]


if __name__ == "__main__":
    main()
