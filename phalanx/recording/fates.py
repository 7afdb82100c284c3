"""Reports on broadcasts, made again from recorded steps."""

from phalanx.network.inbox import AnnouncedInput, DeliveryReport
from phalanx.recording.read import Recording
from phalanx.recording.records import Step
from phalanx.swarm.swarm import Swarm


class RecordedFates:
    """The fates that receivers reported; a true claim has no state."""

    def __init__(self, recording: Recording, swarm: Swarm) -> None:
        self._swarm, self._index = swarm, {name: i for i, name in enumerate(swarm.names)}
        self.steps = {(self._index[step.agent], step.k): step for step in recording.steps}
        """By agent and number."""

    def of(self, step: Step) -> list[DeliveryReport]:
        """Return the fates in a step, each with its claim: the truth, unless it is recorded."""
        links, latency = self._swarm.links, self._swarm.time.latency
        states = {(name, k): tuple(x) for name, k, x in step.false_states}
        false = {
            (name, k): AnnouncedInput(t, tuple(u), states.get((name, k), ()))
            for name, k, t, u in step.false
        }
        faults = {(name, k): names for name, k, names in step.faults}
        fates = []
        for name, k, delay in step.fates:
            origin, claim = self.steps.get((self._index[name], k)), false.get((name, k))
            if claim is None and origin is not None and delay >= 0.0:
                claim = AnnouncedInput(origin.t + latency, origin.u)
            # The judge finds lies by itself.
            numbers = [links.declared.index(fault) for fault in faults.get((name, k), ())]
            of_links = tuple(n for n in numbers if n not in links.lies(name).declared)
            fates.append(DeliveryReport(self._index[name], k, delay, of_links, claim))
        return fates
