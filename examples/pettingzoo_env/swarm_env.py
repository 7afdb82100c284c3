"""A scenario as PettingZoo's ParallelEnv: the actions are inputs of its attackers or defenders.

pip install pettingzoo; train_attacker.py uses it

An observation is all states. An attacker's action is projected onto U_i; a defender's is its
nominal input, which its filter or controller makes safe. The largest h of a pair so far never
falls: its rise in a step is the reward of attackers, and its negative that of defenders. An episode
terminates when a pair is unsafe, and is truncated at the scenario's end.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from gymnasium.spaces import Box
from pettingzoo import ParallelEnv
from scipy.optimize import linprog

import phalanx
from phalanx.extend import CompiledFunction

ROLES = {"attackers": "adversary", "defenders": "normal"}
HELD = {}
"""The action that each acting agent holds, by index: laws and environment share one process."""


@dataclass
class Held:
    """The law of an agent that acts."""

    def prepare(self, dynamics):
        """Hold nothing at first."""
        self.nothing = np.zeros(len(dynamics.inputs))

    def input(self, view):
        """Return the action."""
        return HELD.get(view.i, self.nothing)


class SwarmEnv(ParallelEnv):
    """Runs of a scenario in this process. `run` goes on, or is the last episode's phalanx.Run."""

    metadata = {"name": "phalanx_v0", "render_modes": []}  # noqa: RUF012

    def __init__(self, scenario, acting="attackers", every=0.1, overrides=None):
        """Take scenario and overrides as phalanx.load does; every: time of a step [s]."""
        groups = phalanx.load(scenario, overrides or {}).agents
        acts = [k for k, group in enumerate(groups) if group.role == ROLES[acting]]
        laws = {f"agents.{k}.law": {"type": f"{__name__}:Held"} for k in acts}
        self.scenario, self.overrides, self.every = scenario, {**(overrides or {}), **laws}, every
        self.sign, self.render_mode, self.seed = 1 if acting == "attackers" else -1, None, 0
        self.run, self.agents = None, []
        dynamics = {name: groups[k].dynamics_object() for k in acts for name in groups[k].names}
        with self.start() as run:
            self.names, size = list(run.states), sum(map(len, run.states.values()))
            self.action_spaces = {n: box(d, run.states[n]) for n, d in dynamics.items()}
        self.possible_agents, states = list(dynamics), Box(-np.inf, np.inf, (size,), np.float64)
        self.observation_spaces = dict.fromkeys(dynamics, states)

    def start(self):
        """Begin a run of the seed."""
        HELD.clear()
        return phalanx.start(phalanx.load(self.scenario, self.overrides, seed=self.seed))

    def observation_space(self, agent):
        """Return the space of all states."""
        return self.observation_spaces[agent]

    def action_space(self, agent):
        """Return the smallest box around the agent's U_i at its start."""
        return self.action_spaces[agent]

    def reset(self, seed=None, options=None):
        """Begin an episode at t = 0, by default with the seed after that of the last one."""
        self.close()
        self.seed = self.seed + 1 if seed is None else seed
        self.run, self.steps, self.agents = self.start(), 0, list(self.possible_agents)
        self.peak = max(self.run.h.values())
        return self.observe()

    def step(self, actions):
        """Hold these actions for the time of a step."""
        for name in self.agents:
            HELD[self.names.index(name)] = np.array(actions[name], dtype=float)
        self.steps += 1
        run, peak = self.run, self.peak
        while run.t < self.steps * self.every and run.step():
            peak = max(peak, *run.h.values())
        rise, self.peak = self.sign * (peak - self.peak), peak
        observed, infos = self.observe()
        values = rise, peak > 0.0, run.over and peak <= 0.0
        rewards, unsafe, truncated = (dict.fromkeys(self.agents, value) for value in values)
        if peak > 0.0 or run.over:
            self.run, self.agents = run.end(), []
            for info in infos.values():
                info["verdict"] = "violated" if peak > 0.0 else str(self.run.verdict)
        return observed, rewards, unsafe, truncated, infos

    def observe(self):
        """Return the observation and the information of each agent."""
        x = np.concatenate([*self.run.states.values()])
        info = {"t": self.run.t, "peak": self.peak}
        return {n: x.copy() for n in self.agents}, {n: {**info} for n in self.agents}

    def close(self):
        """End the episode."""
        if self.agents:
            self.run, self.agents = self.run.end(), []


def box(dynamics, start):
    """Return the smallest box around U_i = {u : A u <= b} at a state."""
    x, axes = ca.SX.sym("x", len(start)), np.eye(len(dynamics.inputs))
    A, b = CompiledFunction([x], [*dynamics.input_polytope(x)])(start)
    sides = A.reshape(len(b), -1), b
    low, high = (
        np.array([sign * linprog(sign * axis, *sides, bounds=(None, None)).fun for axis in axes])
        for sign in (1, -1)
    )
    return Box(low, high, dtype=np.float64)
