"""A swarm as PettingZoo's ParallelEnv: attackers, defenders or both act."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from pettingzoo import ParallelEnv

from phalanx.arrays import Array
from phalanx.guarantee.verdict import Summary
from phalanx.launcher.trunk import Trunk
from phalanx.recording.tables import h_of_pairs
from phalanx.scenario.load import load
from phalanx.scenario.model import Scenario
from phalanx.swarm.runnable import require_runnable, with_scenario
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.laws.law import Law, View
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import polytope

ATTACKERS, DEFENDERS, BOTH = "attackers", "defenders", "both"


class SwarmEnv(ParallelEnv[str, Array, Array]):  # type: ignore[misc]
    """Runs of a scenario in this process, in which the actions are inputs of some agents.

    The largest h of a pair, so far, never falls. By how much it rises in a step is the reward of
    attackers, and its negative that of defenders. An episode terminates when a pair is unsafe, and
    is truncated at the scenario's end.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "phalanx_v0", "render_modes": []}

    def __init__(
        self,
        scenario: Scenario | str | Path,
        *,
        acting: str | Iterable[str] = ATTACKERS,
        every: float | None = None,
    ) -> None:
        """Build the swarm. Takes and raises what phalanx.parallel_env does."""
        self.render_mode = None
        self.summary: Summary | None = None
        """The results of the last episode that ended."""
        self._scenario = scenario if isinstance(scenario, Scenario) else load(scenario)
        swarm = build_swarm(self._scenario)
        self._acting = _indices(swarm, acting)
        self.possible_agents = list(self._acting)
        self.agents: list[str] = []
        periods = [swarm.groups[i].clock.period for i in self._acting.values()]
        self._every = min(periods) if every is None else every
        if not self._every > 0.0:
            raise ValueError(f"every: expected more than 0 s, got {every}")
        wide = np.full(len(swarm.start()) + len(swarm.members), np.inf)
        self.observation_spaces = {n: Box(-wide, wide, dtype=np.float64) for n in self._acting}
        self.action_spaces = {n: _box(swarm, i) for n, i in self._acting.items()}
        held = {i: np.zeros(self.action_spaces[name].shape) for name, i in self._acting.items()}
        acted = ActedSwarm(self._scenario, swarm.safe_set, swarm.pairs, held)
        self._held, self._rows = held, require_runnable(acted)
        self._trunk: Trunk | None = None
        self._next_seed = self._scenario.seed

    def observation_space(self, agent: str) -> Box:
        """Return the space of stacked states, then 1 for each agent in sight and 0 for others.

        States of agents out of sight are 0.
        """
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """Return the agent's U_i at its start, or the smallest box around it."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
        """Begin an episode at t = 0, by default with the seed after that of the last one.

        seed: of the run: starts, clocks, links, disturbances. What the scenario's file draws when
        it is read, flows and scattered obstacles, stays. options: none are known.
        """
        self.close()
        seed = self._next_seed if seed is None else seed
        self._next_seed, self._steps = seed + 1, 0
        rows = with_scenario(self._rows, self._scenario.model_copy(update={"seed": seed}))
        self._swarm, self._trunk = rows.swarm, Trunk(rows)
        self._peak = self._largest_h(self._trunk.x)
        self.agents = list(self.possible_agents)
        return self._observed(self._trunk), self._infos(self._trunk, self._peak)

    def step(
        self, actions: dict[str, Array]
    ) -> tuple[
        dict[str, Array],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Hold these actions, and go on for the time of a step.

        Raises ValueError if the episode is over, or an action is missing or is not of finite
        numbers; SwarmBrokenError or DivergedError if the run broke.
        """
        if self._trunk is None or not self.agents:
            raise ValueError("the episode is over: call reset")
        for name in self.agents:
            self._held[self._acting[name]] = self._checked(name, actions)
        self._steps += 1
        trunk, end = self._trunk, self._steps * self._every
        trunk.advance(end)
        over = end >= self._scenario.duration
        if over:
            self.summary = trunk.finish()
        h = self._largest_h(trunk.x)
        # A pair may have been unsafe since the last step, and be safe again.
        peak = max(self._peak, h, trunk.worst_h)
        rise, self._peak = peak - self._peak, peak
        if broken := peak > 0.0:
            h = peak
            if not over:
                self.summary = trunk.stop()
        observed, infos = self._observed(trunk), self._infos(trunk, h)
        if ended := over or broken:
            for info in infos.values():
                info["verdict"] = str(self.summary.outcome) if self.summary else ""
        adversary = {n: self._swarm.members[self._acting[n]].adversary for n in self.agents}
        rewards = {name: rise if attacks else -rise for name, attacks in adversary.items()}
        unsafe = dict.fromkeys(self.agents, broken)
        truncated = dict.fromkeys(self.agents, over and not broken)
        if ended:
            self.agents = []
        return observed, rewards, unsafe, truncated, infos

    def render(self) -> None:
        """Do nothing: a run is drawn from its recording, and an episode has none."""

    def close(self) -> None:
        """End the episode."""
        if self._trunk is not None:
            self._trunk.close()
        self._trunk, self.agents = None, []

    def _checked(self, name: str, actions: dict[str, Array]) -> Array:
        size = self.action_spaces[name].shape
        action = np.array(actions.get(name), dtype=np.float64)
        if action.shape != size or not (np.abs(action) <= LARGEST).all():
            expected = f"expected {size[0]} finite numbers for agent {name}"
            raise ValueError(f"actions: {expected}, got {actions.get(name)!r}")
        return action

    def _largest_h(self, x: Array) -> float:
        return max(float(h[0]) for h in h_of_pairs(self._swarm, x[None]).values())

    def _observed(self, trunk: Trunk) -> dict[str, Array]:
        parts, found = self._swarm.safe_set.parts, {}
        for name in self.agents:
            sight, x = np.zeros(len(parts)), np.zeros_like(trunk.x)
            for l in self._swarm.seen(self._acting[name], trunk.x):
                sight[l], x[parts[l]] = 1.0, trunk.x[parts[l]]
            found[name] = np.concatenate([x, sight])
        return found

    def _infos(self, trunk: Trunk, h: float) -> dict[str, dict[str, Any]]:
        return {name: {"t": trunk.t, "h": h} for name in self.agents}


def _indices(swarm: Swarm, acting: str | Iterable[str]) -> dict[str, int]:
    """Return the index of each acting agent by name."""
    index = {name: i for i, name in enumerate(swarm.names)}
    if isinstance(acting, str):
        roles = {ATTACKERS: (True,), DEFENDERS: (False,), BOTH: (True, False)}.get(acting)
        if roles is None:
            raise ValueError(f"acting: expected {ATTACKERS}, {DEFENDERS}, {BOTH}, got {acting!r}")
        chosen = [m.name for m in swarm.members if m.adversary in roles]
    else:
        chosen = list(acting)
    if not chosen or not index.keys() >= set(chosen):
        raise ValueError(f"acting: expected some of the agents {[*index]}, got {chosen}")
    return {name: index[name] for name in chosen}


def _box(swarm: Swarm, i: int) -> Box:
    own = swarm.safe_set.parts[i]
    x, dynamics = swarm.safe_set.x[own], swarm.members[i].dynamics
    A, b = CompiledFunction([x], [*dynamics.input_polytope(x)])(swarm.start()[own])
    corners = polytope(A.reshape(len(b), -1), b).corners
    return Box(corners.min(axis=0), corners.max(axis=0), dtype=np.float64)


@dataclass(frozen=True)
class ActedSwarm(Swarm):
    """A swarm whose acting agents have no law of the scenario's.

    An adversary's action is projected onto U_i. A normal agent's is its nominal input: its filter
    or controller makes it safe, or none does with `controller = { type = "none" }`.
    """

    actions: Mapping[int, Array] = field(default_factory=dict)
    """The action that each acting agent holds, by index, shape (m_i,); it may change."""

    def law(self, i: int) -> Law:
        """Return the law of agent i, which holds its action if it acts."""
        return Held(self.actions, i) if i in self.actions else super().law(i)


@dataclass(frozen=True)
class Held:
    """The action of one agent, whatever it sees."""

    actions: Mapping[int, Array]
    i: int

    def prepare(self, dynamics: Dynamics) -> None:
        """Do nothing: an action fits every dynamics."""

    def input(self, view: View) -> Array:
        return self.actions[self.i]
