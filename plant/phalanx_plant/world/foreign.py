"""A scenario's own world in the place of the plant's integration.

Between two of its states the disturbance is the constant that explains the motion under the
declared dynamics: it is judged as a drawn one is.
"""

from collections.abc import Iterator

import numpy as np

from phalanx.guarantee.disturbance_ledger import DisturbanceLedger
from phalanx.schema.registry import is_users
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.user_methods import MistakenMethodError
from phalanx.theory.models.world import World, WorldAgent, WorldError, advanced
from phalanx_plant.world.motion import by_dynamics
from phalanx_plant.world.world import DisturbanceKnot, History, Integration, Piece, Segment


class ForeignIntegration(Integration):
    """The states of a world, as pieces of a history. Lookahead cannot run ahead of it."""

    def __init__(self, swarm: Swarm, world: World) -> None:
        super().__init__(swarm)
        self._world = world
        nothing = np.zeros_like(self.x)  # before any motion no disturbance is known
        self.start = [self._segment_at_start(nothing, nothing)]
        self._seeds, self._reseeded = swarm.seeds, 0
        self._parts = swarm.safe_set.parts
        members = zip(swarm.members, self._parts, strict=True)
        self._agents = [WorldAgent(m.name, m.dynamics, self.x[part].copy()) for m, part in members]
        self._ledgers = [(DisturbanceLedger(g.dynamics), g) for g in by_dynamics(swarm.members)]
        seed = swarm.seeds.at(0.0)
        try:
            world.begin(self._agents, seed, self._longest)
        except MistakenMethodError as error:
            why = error.__cause__
            if isinstance(why, ValueError | RuntimeError) and not is_users(
                swarm.scenario.world or {}
            ):
                raise WorldError(f"world: {why}") from error
            raise

    def close(self) -> None:
        """Close the world, if it can be closed."""
        close = getattr(self._world, "close", None)
        if callable(close):
            close()

    def hold(self, i: int, u: Array | float) -> None:
        """Make agent i's actuator hold u, shape (m_i,), from now on."""
        super().hold(i, u)
        agent = self._agents[i]
        self._world.hold(agent.name, self.held(i))

    def integrate(self, until: float) -> History:
        """Advance the world to `until` [s], with each new seed from its time on.

        Raises MistakenMethodError.
        """
        history: History = []
        for at, seed in self._seeds.later[self._reseeded :]:
            if at >= until:
                break
            history += self._advance(at)
            self._world.reseed(seed)
            self._reseeded += 1
        return [*history, *self._advance(until)]

    def _advance(self, until: float) -> Iterator[Piece]:
        if not self.t < until:
            return
        motion = advanced(self._world, self._agents, self.t, until, self._longest)
        yield from motion.notes
        x = np.concatenate([motion.x[agent.name] for agent in self._agents], axis=1)
        u, still = self._u, np.zeros_like(self.x)
        before, seconds = np.vstack([self.x[None], x[:-1]]), np.diff(motion.t, prepend=self.t)
        phi = self._explained(before, x, u, seconds)
        for k, t in enumerate(motion.t.tolist()):
            begin, start = self.t, self.x
            self.t, self.x, self.p = t, x[k], self.motion.positions(x[k])
            yield DisturbanceKnot(t, phi[k])
            yield Segment(begin, t - begin, t, phi[k], still, u, start, x[k : k + 1], self.p[None])

    def _explained(self, before: Array, after: Array, u: Array, seconds: Array) -> Array:
        """Return the disturbance of each step, stacked; not a number where none explains it."""
        phi = np.empty_like(after)
        for ledger, (_, _, states, inputs) in self._ledgers:
            r, n = states.shape
            first, last = (x[:, states].reshape(-1, n) for x in (before, after))
            held = np.tile(u[inputs], (len(after), 1))
            explanation = ledger.explain(first, last, held, np.repeat(seconds, r))
            explained = np.where(np.isfinite(explanation.size)[:, None], explanation.phi, np.nan)
            phi[:, states] = explained.reshape(-1, r, n)
        return phi
