"""The tables of a run: who the agents are, what they know, and the room for what they do.

Nothing is computed otherwise than in process: formulas are the functions that agents call there.
"""

import math
from typing import Any

import numpy as np
from phalanx_plant.sampling.sensing import sensing_radii
from phalanx_plant.world.motion import by_dynamics
from phalanx_plant.world.world import RungeKutta

from phalanx.native.loop.goals import goal_tables
from phalanx.native.loop.kernels import Kernels, begins
from phalanx.native.loop.laws import law_table, law_tables
from phalanx.native.loop.memory import FACE, MOST_IN_SEGMENT, MOST_INPUTS, RING, Memory
from phalanx.native.loop.pairs import pair_tables
from phalanx.native.loop.rules import rule_tables, words_of
from phalanx.native.loop.terms import terms_memory
from phalanx.network.draws import key_of
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.laws.attacks import WorstCase
from phalanx.theory.rows.information import InFlight, Paper
from phalanx.theory.rows.nearest_in_box import compiled_nearest

_INSTANTS, _SEGMENTS, _FATES, _FLIGHTS = 1024, 2048, 32768, 4096
"""Room for results of one call, and for copies that are under way."""


class RunMemory:
    """The memory of a run from x(0) on, with all that it points to."""

    def __init__(self, rows: SafetyRows, kernels: Kernels) -> None:
        """Fill the tables; without all functions the run cannot begin."""
        swarm, count = rows.swarm, len(rows.swarm.members)
        axes, n = swarm.groups[0].axes, swarm.safe_set.parts[-1].stop
        inputs = begins(len(member.dynamics.inputs) for member in swarm.members)
        every = range(count)
        composed = any(isinstance(g.law_object(), WorstCase) for g in swarm.groups)
        composed = composed or not swarm.safety.pairwise
        terms = terms_memory(kernels, [rows.terms(i) for i in every], every, composed)
        laws = [law_table(kernels, swarm.law(i), axes, count) for i in every]
        self._kept = kernels, terms, laws
        self.run = Memory(
            "Run",
            {
                "agents": count, "axes": axes, "latency": swarm.time.latency,
                "step": swarm.time.integration_step, "duration": swarm.scenario.duration,
                "state_at": begins(len(member.dynamics.states) for member in swarm.members),
                "input_at": inputs,
                **_agents(swarm), **rule_tables(swarm), **_motion(rows, kernels),
                **goal_tables([swarm.goal(i).reference for i in every], axes),
                **law_tables(laws), **_rows(rows), **pair_tables(rows, kernels),
                "terms": terms.words, "nearest": kernels.place(compiled_nearest()),
                **_state(rows, count, n, inputs[-1]), **_results(count, axes, n, inputs[-1]),
            },
        )  # fmt: skip


def _agents(swarm: Swarm) -> dict[str, Any]:
    """Return the tables of roles, clocks and sensing."""
    clocks, count = [group.clock for group in swarm.groups], range(len(swarm.members))
    radii = sensing_radii(swarm)
    return {
        "adversary": [member.adversary for member in swarm.members],
        "period": [clock.period for clock in clocks],
        "jitter": [clock.jitter for clock in clocks],
        "clock_key": [words_of(key_of(swarm.seed, ("clock", name))) for name in swarm.names],
        "hears": [[j in swarm.heard_by(i) for j in count] for i in count],
        "reach": radii * radii,
        "limited": bool(np.isfinite(radii).any()),
    }


def _motion(rows: SafetyRows, kernels: Kernels) -> dict[str, Any]:
    """Return the tables of the motion, by equations of motion, and of the disturbances."""
    swarm = rows.swarm
    groups, models = by_dynamics(swarm.members), [group.disturbance for group in swarm.groups]
    states = [len(member.dynamics.states) for member in swarm.members]
    return {
        "kinds": len(groups),
        "kind_at": begins(len(group.agents) for group in groups),
        "kind_agent": np.concatenate([group.agents for group in groups]),
        "motion": [[kernels(f) for f in kind.steps] for kind in RungeKutta(rows).motion.groups],
        "knot_key": [words_of(key_of(swarm.seed, ("disturbance", n))) for n in swarm.names],
        "half_width": [m.bound / math.sqrt(n) for m, n in zip(models, states, strict=True)],
        "every": [model.every for model in models],
    }


def _rows(rows: SafetyRows) -> dict[str, Any]:
    """Return the tables of margins, and of what counts of received inputs."""
    swarm, information, nan = rows.swarm, rows.swarm.information(), math.nan
    faces = np.zeros((len(swarm.members), 2 * MOST_INPUTS, FACE))
    polytopes = rows.composed.members.constant_polytopes
    for i, polytope in polytopes.items():
        r, m = polytope.A.shape
        faces[i, :r, :m], faces[i, :r, MOST_INPUTS] = polytope.A, polytope.b
    return {
        "margin": [nan if m.adversary else rows.margin(i).eta for i, m in enumerate(swarm.members)],
        "information": {Paper: 0, InFlight: 1}.get(type(information), 2),
        "silence": information.silence,
        "unchanged": [information.unchanged.get(i, 0.0) for i in range(len(swarm.members))],
        "faces": faces,
        "face_count": [len(polytopes[i].b) for i in range(len(swarm.members))],
    }


def _state(rows: SafetyRows, count: int, n: int, m: int) -> dict[str, Any]:
    """Return the state at t = 0, where all agents sample, and nothing was said."""
    integration = RungeKutta(rows)
    never, nothing = np.full((count, 2), -np.inf), np.full((count, count), -1)
    return {
        "t": 0.0, "x": integration.x, "p": integration.p, "u": np.zeros(m),
        "line_begin": 0.0, "line_end": 0.0, "phi": np.zeros(n), "slope": np.zeros(n),
        "k": np.zeros(count), "next_sample": np.zeros(count), "due": np.full(count, np.inf),
        "pending": np.zeros((count, MOST_INPUTS)), "newest_step": np.zeros(count),
        "contact": nothing, "heard": np.zeros((count, count)), "broadcast_t": never,
        "broadcast_k": np.full((count, 2), -1), "said_t": np.zeros((count, RING)),
        "said_u": np.zeros((count, RING, MOST_INPUTS)), "since": nothing, "decided": nothing,
        "newest": nothing, "in_sight": np.zeros((count, count)), "received": nothing, "ranks": 0,
        "received_t": np.zeros((count, count)),
        "received_u": np.zeros((count, count, MOST_INPUTS)),
        "flights": 0, "flight": np.zeros((_FLIGHTS, 5 + MOST_INPUTS)),
        "rejected": np.zeros(count), "scratch": np.zeros(16 * n + 8 * m + 64 * count + 1024),
    }  # fmt: skip


def _results(count: int, axes: int, n: int, m: int) -> dict[str, Any]:
    """Return the room for what happens in one call."""
    instants, segments = np.zeros(_INSTANTS), np.zeros(_SEGMENTS)
    steps, most_steps = np.zeros(_INSTANTS + count), _INSTANTS + count
    ages, fates = np.zeros(most_steps * count), np.zeros(_FATES)
    return {
        "instants": 0, "instant_t": instants, "instant_steps": instants,
        "instant_applied": instants, "instant_segments": instants,
        "segments": 0, "segment_t": segments, "segment_dt": segments,
        "segment_steps": segments, "segment_knot": segments,
        "segment_phi": np.zeros((_SEGMENTS, n)), "segment_slope": np.zeros((_SEGMENTS, n)),
        "segment_u": np.zeros((_SEGMENTS, m)), "segment_start": np.zeros((_SEGMENTS, n)),
        "segment_x": np.zeros((_SEGMENTS, MOST_IN_SEGMENT, n)),
        "segment_p": np.zeros((_SEGMENTS, MOST_IN_SEGMENT, count, axes)),
        "first_step": 0, "steps": 0, "step_i": steps, "step_k": steps, "step_t": steps,
        "step_origin": steps, "step_residual": steps, "step_margin": steps,
        "step_wish": np.zeros((most_steps, MOST_INPUTS)),
        "step_u": np.zeros((most_steps, MOST_INPUTS)),
        "step_rejected": steps, "step_ages": steps, "step_fates": steps, "step_bindings": steps,
        "ages": 0, "age_of": ages, "age": ages,
        "fates": 0, "fate_from": fates, "fate_k": fates, "fate_delay": fates, "fate_faults": fates,
        "applied": 0, "applied_step": steps,
        "most_instants": _INSTANTS, "most_segments": _SEGMENTS, "most_steps": most_steps,
        "most_ages": len(ages), "most_fates": _FATES, "most_flights": _FLIGHTS,
    }  # fmt: skip
