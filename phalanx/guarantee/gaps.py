"""Why a scenario's margin and rows, as they are written, prove nothing."""

from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.information import Information


def gaps_in_the_proof(swarm: Swarm) -> list[str]:
    """What is missing for a proof, in words; empty if nothing is.

    What a run can check, such as the sampling gap and the age of û, is not among these.
    """
    safety = swarm.scenario.safety
    gaps = {
        "η is given or from given constants, not a bound": safety.margin != "local",
        "the margin is scaled down": safety.margin_scale < 1.0,
        "shares of h_tot computed from different samples are not bounded: use pairs": (
            safety.control == "distributed"
            and safety.composition == "lse"
            and safety.information is Information.SPLIT
        ),
        "h_tot^i changes as pairs enter and leave the neighbourhood": swarm.radius is not None,
        "Theorem 1 needs agents that sample together, with one period and no jitter": (
            safety.control == "centralised" and not swarm.synchronous
        ),
        "no certified input is in force before the latency is over": (
            swarm.scenario.time.latency > 0.0
        ),
    }
    return [gap for gap, open_ in gaps.items() if open_]
