"""What a guarantee and the paper's theorem assume of a run, each counted as often as it is asked.

The judge checks them; which of them count depends on the scenario, and some on what happened.
"""

from phalanx.guarantee.advice import gaps_in_the_proof
from phalanx.guarantee.certificate import DEFECT
from phalanx.guarantee.verdict import Assumption
from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.information import Information

STAYED = "no ψ_1 ... ψ_{q-1} was above 0: from there the safe set cannot be kept for sure"


class Assumptions:
    """The assumptions of one run."""

    def __init__(self, swarm: Swarm, certificates: Assumption, broadcasts: Assumption) -> None:
        """Of one run: certificates says that they covered it, broadcasts that all were true."""
        safety = swarm.scenario.safety
        self._centralised = safety.control == "centralised"
        self._counts_on_received = not self._centralised and safety.information in (
            Information.PAPER,
            Information.IN_FLIGHT,
        )
        self._certificates, self._broadcasts = certificates, broadcasts
        self.start = Assumption("start in S", note="every pair is safe at the start")
        self.start_kept = Assumption(
            "start in S_I", note="every agent starts where the safe set can be kept"
        )
        self.gap = Assumption(
            "sampling gap", note="no sample came later than clock.period + clock.jitter"
        )
        self.disturbance = Assumption(
            "disturbance bound", note="no disturbance was larger than disturbance.bound"
        )
        self.resolved = Assumption(
            "resolved motion",
            note=f"no integration step was off the equation of motion by more than {DEFECT:g} in "
            "a second, which certificates allow for; a shorter time.integration_step and dynamics "
            "without kinks bring it down",
        )
        self.inputs = Assumption("admissible inputs", note="no actuator held an input outside U")
        self.prompt = Assumption(
            "inputs in time", note="every input came to its actuator when it was due"
        )
        self.rows = Assumption(
            "non-empty K_i", note="at every step of every normal agent some input kept its rows"
        )
        self.fresh = Assumption(
            "received inputs in force",
            note="every received input that a row counted on was being applied",
        )
        self.faithful = Assumption("faithful agents", note="no normal agent fell silent or turned")
        self.truthful = Assumption(
            "truthful sensors", note="every sample of a normal agent told the true state"
        )
        self.synchronous = Assumption(
            "synchronous sampling", note="all normal agents sample at the same instants"
        )
        self.margin = _proven_margin(swarm)
        self.stayed = Assumption("stayed in S_I", note=STAYED)

    @property
    def of_guarantee(self) -> list[Assumption]:
        """What `guaranteed` rests on, and how often each failed so far."""
        found = [self.start, self.gap, self.disturbance, self.inputs, self._certificates]
        return [*found, *[each for each in (self.resolved, self.prompt) if each.failed]]

    @property
    def of_theorem(self) -> list[Assumption]:
        """What the paper's theorem needs, and how often each failed so far."""
        found = [self.start_kept, self.gap, self.disturbance, self.rows, self.margin]
        found += [self.stayed] if self.stayed.checked else []
        found += [each for each in (self.prompt, self.faithful, self.truthful) if each.failed]
        if self._centralised:
            return [*found, self.synchronous]
        return [*found, self.fresh, self._broadcasts] if self._counts_on_received else found


def _proven_margin(swarm: Swarm) -> Assumption:
    gaps = gaps_in_the_proof(swarm)
    note = "; ".join(gaps) or "the margin is a bound, computed at each sample"
    margin = Assumption("proven margin", note=note)
    margin.check(not gaps, 0.0)
    return margin
