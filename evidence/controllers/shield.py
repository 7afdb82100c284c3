"""The example of docs/your-controller.md: a filter that asks for certificates."""

from dataclasses import dataclass

from phalanx.extend import Array, ControlledAgent, ControllerView


@dataclass
class Shield:
    """An input near the nominal one that is proven safe for long enough, or longest."""

    periods: float = 4.0

    def prepare(self, agent: ControlledAgent) -> None:
        self.least = self.periods * agent.period

    def input(self, view: ControllerView) -> Array:
        best = nominal = view.nearest(view.u_nom)
        longest = view.certified(nominal)
        for share in (0.25, 0.5, 0.75, 1.0):
            for corner in view.inputs.corners:
                if longest >= self.least:
                    return best
                u = (1.0 - share) * nominal + share * corner
                if (horizon := view.certified(u)) > longest:
                    best, longest = u, horizon
        return best
