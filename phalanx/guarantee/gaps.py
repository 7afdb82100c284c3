"""Why a scenario's margin and rows, as they are written, prove nothing."""

from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.information import Information


def gaps_in_the_proof(swarm: Swarm) -> list[str]:
    """What is missing for a proof, in words; empty if nothing is.

    What a run can check, such as the sampling gap and the age of û, is not among these.
    """
    safety = swarm.scenario.safety
    gaps = {
        "the margin η is a given number, not a bound: set safety.margin = 'local'": safety.margin
        != "local",
        "safety.margin_scale is below 1, so the margin is less than its bound": (
            safety.margin_scale < 1.0
        ),
        "agents compute their shares of one row for all pairs from different samples: set "
        "safety.composition = 'pairs'": (
            safety.control == "distributed"
            and safety.composition == "lse"
            and safety.information is Information.SPLIT
        ),
        "with safety.neighbourhood each agent's condition changes as others come and go: leave it "
        "out": swarm.radius is not None,
        "one controller needs agents that sample together: one clock.period, no clock.jitter": (
            safety.control == "centralised" and not swarm.synchronous
        ),
        "until time.latency is over no certified input is in force: leave it out": (
            swarm.scenario.time.latency > 0.0
        ),
    }
    return [gap for gap, open_ in gaps.items() if open_]
