"""Convictions by what agents signed, and the bytes and CPU time of it.

python evidence/unknown/signed_evidence.py --seeds 100
"""

import argparse
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from phalanx_agent.replay import StepReplay

import phalanx
from phalanx.guarantee.verdict import Proof, TrustSummary
from phalanx.launcher.in_process_engine import DirectRun, RecordsInMemory, simulate
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.wire.audit import Auditor
from phalanx.wire.membership import Membership
from phalanx.wire.messages import (
    AuditedBroadcast,
    AuditedClaim,
    Broadcast,
    SignedBroadcast,
    SignedClaim,
)

NETWORK = {"network.loss": {"mean": 0.3, "burst": 3.0}, "network.delay": 0.013}
SIGNED = {"safety.evidence": True, "duration": 0.8, **NETWORK}
AUDITED = {**SIGNED, "safety.audit": True, "duration": 2.0}
LIES: Mapping[str, tuple[Mapping[str, Any], Mapping[str, Any] | None]] = {
    "another input to every peer": (SIGNED, {"kind": "lie", "equivocate": True}),
    "a lie to one, the truth to the other": (SIGNED, {"kind": "lie", "says": "zero", "to": ["1"]}),
    "no lie, without audits": (SIGNED, None),
    "the opposite input": (AUDITED, {"kind": "lie", "says": "opposite"}),
    "an input of 20 steps ago": (AUDITED, {"kind": "lie", "replay": 20}),
    "an attack, announced as it is": (AUDITED, {"kind": "turn"}),
    "no lie": (AUDITED, None),
}
"""By name, the scenario's changes, and the fault of agent 2 from 0.2 s on."""
BOTH = {("1", "2"), ("3", "2")}
"""Who convicts whom."""
VARIANTS = ("watch", "evidence", "audit")
ROUNDS = 7


def main() -> None:
    """Print the three tables."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=100)
    seeds = arguments.parse_args().seeds
    print("| agent 2 | runs | convicted by both peers | median delay [ms] | false |")
    print("|---|---|---|---|---|")
    for name, (changes, fault) in LIES.items():
        convicted, delays, false = convictions(changes, fault, seeds)
        delay = f"{1e3 * np.median(delays):.0f}" if delays else ""
        print(f"| {name} | {seeds} | {convicted} | {delay} | {false} |", flush=True)
    print("\n| broadcast | bytes |\n|---|---|")
    for name, size in sizes().items():
        print(f"| {name} | {size} |")
    print("\n| scenario | watch [µs] | with evidence [µs] | with audits [µs] |\n|---|---|---|---|")
    for scenario in ("unicycles", "swarm2d"):
        rounds = np.array(turns(scenario))
        cells = zip(
            np.median(rounds, axis=0), np.median(rounds / rounds[:, :1], axis=0), strict=True
        )
        print(f"| {scenario} | " + " | ".join(f"{t:.0f} ({r:.2f})" for t, r in cells) + " |")
    print(f"\nA step computed again: {replay_time():.0f} µs")


def convictions(
    changes: Mapping[str, Any], fault: Mapping[str, Any] | None, seeds: int
) -> tuple[int, list[float], int]:
    """Count runs in which both peers prove it; return delays [s] and all other convictions."""
    kind = fault["kind"] if fault else ""
    who = {"agents": ["2"]} if kind == "turn" else {"agent": "2", "for": 9.0}
    faults = [{"at": 0.2, **who, **fault}] if fault else []
    proof: Proof = "replay" if "safety.audit" in changes else "equivocation"
    first, *others = (
        phalanx.load("unicycles", {**changes, "faults": faults}, seed) for seed in range(seeds)
    )
    rows = build_rows(build_swarm(first))
    convicted, delays, false = 0, list[float](), 0
    for each in (rows, *map(rows.with_scenario, others)):
        trust = trust_of(each, proof)
        convicted += {(c.by, c.of) for c in trust.convictions if c.proof == proof} == BOTH
        delays += [c.after for c in trust.convictions if c.proof == proof and c.after is not None]
        false += trust.false
    return convicted, delays, false


def trust_of(rows: SafetyRows, proof: Proof) -> TrustSummary:
    """Run until both peers have proof against agent 2, or to the end."""
    run = DirectRun(rows, None)
    instants = run.clock.instants(rows.swarm.scenario.duration)
    for _ in instants:
        trust = run.plant.judge.trust
        assert trust is not None
        if {(each.by, each.of) for each in trust.convictions if each.proof == proof} == BOTH:
            break
    instants.close()
    found = run.plant.judge.trust
    assert found is not None
    return found


def sizes() -> dict[str, int]:
    """Return the length of payloads of a unicycle [bytes]; a reveal is of five in sight."""
    whole = Membership("in-process", "")
    key = whole.keys.broadcast("1", "2")
    auditor, _ = audited()
    k, reveal = max(auditor.kept.items())
    claim = auditor.witness.claim(1, k - 3)
    assert isinstance(claim, AuditedClaim)
    plain = SignedClaim(1, claim.k, claim.t_apply, claim.u, claim.signature)
    fields: dict[str, Any] = {"k": k, "t_apply": claim.t_apply, "u": claim.u}
    signed = {**fields, "signature": claim.signature}
    own = {**signed, "relayed": (claim,), "digest": claim.digest}
    shown = auditor.witness.signatures.sign_reveal(reveal)
    messages = {
        "plain": Broadcast(**fields),
        "signed": SignedBroadcast(**signed),
        "with a relayed claim": SignedBroadcast(**signed, relayed=(plain,)),
        "with evidence": SignedBroadcast(**signed, relayed=(plain, plain)),
        "audited, with a relayed claim": AuditedBroadcast(**own),
        "with a challenge": AuditedBroadcast(**own, challenge=(1, k)),
        "with a reveal": AuditedBroadcast(**own, reveal=shown),
    }
    return {name: len(whole.sealer.seal(key, message)) for name, message in messages.items()}


def audited() -> tuple[Auditor, SafetyRows]:
    """Run `unicycles` for a second, and return the auditor of agent 1."""
    changes = {"duration": 1.0, **switches("audit")}
    rows = build_rows(build_swarm(phalanx.load("unicycles", changes)))
    agents = DirectRun(rows, None)
    agents.plant.run()
    audits = agents.agents.steps[0].audits
    assert audits is not None
    return audits.auditor, rows


def switches(variant: str) -> dict[str, bool]:
    """Return the fields of a variant: audits need evidence."""
    return {
        f"safety.{name}": True for name in VARIANTS[1 : VARIANTS.index(variant) + 1] or VARIANTS[:1]
    }


def turns(scenario: str) -> list[list[float]]:
    """Return the CPU time of a run per control step in each round, by variant [µs]."""
    built = [
        build_rows(build_swarm(phalanx.load(scenario, {"duration": 1.0, **switches(variant)})))
        for variant in VARIANTS
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


def replay_time() -> float:
    """Return the CPU time of a replayed step of a unicycle [µs]."""
    auditor, rows = audited()
    kept, replay = list(auditor.kept.values()), StepReplay(rows)
    replay(kept[0])
    begun = time.process_time()
    for reveal in kept:
        replay(reveal)
    return 1e6 * (time.process_time() - begun) / len(kept)


if __name__ == "__main__":
    main()
