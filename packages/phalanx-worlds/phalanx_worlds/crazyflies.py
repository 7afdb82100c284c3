"""Crazyflies as the package `drone-models` has them: thrust and attitude fitted to flights.

A driver aboard turns a specific thrust and tilt angles into the firmware's commands, by the
identified gains, so that constant inputs are reached. What it cannot change are the lags: the
attitude's is of second order. The arithmetic is portable: the same bits on any machine.
"""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from inspect import Parameter, signature
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.aerial import GRAVITY, IdentifiedQuadrotor, Quadrotor
from phalanx.theory.models.dynamics import Dynamics, weighted_rates
from phalanx.theory.models.world import Determinism, WorldAgent, WorldStates

_SWITCH = "SCIPY_ARRAY_API"
"""drone-models refuses a SciPy that was loaded without it; the expressions do not use SciPy."""


@dataclass
class Crazyflies:
    """Crazyflies in the coordinates of `quadrotor` or `identified-quadrotor`, with yaw 0.

    Under `identified-quadrotor` the driver filters thrusts, as is declared. Nothing is drawn.
    """

    drone: str = "cf2x_L250"
    """Parameters: a configuration of drone-models."""
    model: str = "so_rpy_rotor"
    """A model of drone-models with rotors and fitted attitude: so_rpy_rotor, so_rpy_rotor_drag."""

    @property
    def determinism(self) -> Determinism:
        """Portable arithmetic alone."""
        return "bits"

    def require_robots(self, agents: Mapping[str, Dynamics]) -> None:
        """Raise ValueError unless all agents, by name, have the states of a quadrotor."""
        for name, dynamics in agents.items():
            if tuple(dynamics.states) not in (Quadrotor.states, IdentifiedQuadrotor.states):
                raise ValueError(f"agent {name}: expected dynamics with states of quadrotor")

    def begin(self, agents: Sequence[WorldAgent], seed: int, step: float) -> None:
        """Start all drones without turning. Raises ValueError."""
        self._t, self._step = 0.0, step
        lags = {agent.name: _filter_lag(agent) for agent in agents}
        motions = {lag: _Motion(self.drone, self.model, lag) for lag in lags.values()}
        self._motions = {name: motions[lag] for name, lag in lags.items()}
        self._x = {a.name: motions[lags[a.name]].start(np.asarray(a.start)) for a in agents}
        self._u = {name: np.zeros(len(Quadrotor.inputs)) for name in self._x}

    def reseed(self, seed: int) -> None:
        """Do nothing: no drone draws."""

    def hold(self, name: str, u: Array) -> None:
        """Make a drone's driver hold u. Raises ValueError."""
        if name not in self._u or np.shape(u) != (3,) or not np.isfinite(u).all():
            raise ValueError(f"expected a drone and its three finite inputs, got {name}: {u}")
        self._u[name] = np.array(u, dtype=float)

    def advance(self, until: float) -> WorldStates:
        """Move on by fourth-order Runge-Kutta steps. Raises ValueError."""
        if not self._t < until:
            raise ValueError(f"expected more than {self._t:g} s, got {until:g}")
        count = math.ceil((until - self._t) / self._step)
        times = np.linspace(self._t, until, count + 1)
        states = {name: self._moved(name, times) for name in self._x}
        self._t = until
        return WorldStates(times[1:], states)

    def _moved(self, name: str, times: Array) -> Array:
        """Return a drone's declared states at times[1:]."""
        states = []
        for before, t in pairwise(times.tolist()):
            self._x[name], declared = self._motions[name].step(
                self._x[name], self._u[name], t - before
            )
            states.append(declared)
        return np.array(states)


class _Motion:
    """A model's step, and its states for declared ones."""

    def __init__(self, drone: str, model: str, lag: float) -> None:
        """lag: of the thrust's filter [s]; 0 for none."""
        rate, x, u, of = _identified(drone, model)
        self._lift = float(of["cmd_f_coef"] / of["mass"])
        at, dt = ca.SX.sym("x", x.numel() + 1), ca.SX.sym("dt")
        inputs = ca.SX.sym("u", len(Quadrotor.inputs))
        c, theta, phi = ca.vertsplit(inputs)
        gain = (-of["rpy_coef"] / of["cmd_rpy_coef"]).tolist()
        r, n = at[-1], x.numel()
        command = ca.vertcat(
            gain[0] * phi, gain[1] * theta, 0.0, (GRAVITY + (r if lag else c)) / self._lift
        )
        model_rate = ca.Function("f", [x, u], [rate]).expand()(at[:n], command)
        rates = ca.vertcat(model_rate, (c - r) / lag if lag else 0.0)
        field = ca.Function("f", [at, inputs], [rates])
        still = ca.SX.zeros(n + 1)
        after = at + dt / 6 * weighted_rates(field, at, inputs, (still, still, still), dt)
        # Position, attitude, velocity, rates of the attitude, thrust of each rotor [N], filter.
        acceleration = self._lift * after[12] - GRAVITY
        declared = ca.vertcat(after[:3], after[6:9], acceleration, after[4], after[3])
        if lag:
            declared = ca.vertcat(declared, after[-1], after[10], after[9])
        self.step = CompiledFunction([at, inputs, dt], [after, declared])

    def start(self, x: Array) -> Array:
        """Return the model's state and the filter's, shape (17,), for a declared state."""
        position, velocity, (c, theta, phi) = x[:3], x[3:6], x[6:9]
        r, theta_rate, phi_rate = x[9:] if len(x) > 9 else np.zeros(3)
        angles, rates = [phi, theta, 0.0], [phi_rate, theta_rate, 0.0]
        thrusts = np.full(4, (GRAVITY + c) / self._lift)
        return np.concatenate([position, angles, velocity, rates, thrusts, [r]])


def _filter_lag(agent: WorldAgent) -> float:
    """Return the time constant of a drone's thrust filter [s], or 0."""
    identified = tuple(agent.dynamics.states) == IdentifiedQuadrotor.states
    return float(getattr(agent.dynamics, "filter_lag", 0.0)) if identified else 0.0


def _identified(drone: str, model: str) -> tuple[ca.MX, ca.MX, ca.MX, Mapping[str, Any]]:
    """Return x', x and u of a model of drone-models, and its parameters. Raises ValueError."""
    before = os.environ.get(_SWITCH)
    os.environ[_SWITCH] = "1"
    try:
        module = import_module(f"drone_models.{model}")
        parameters = import_module("drone_models.core").load_params(model, drone)
    except ModuleNotFoundError as error:
        raise ValueError(f"model: drone-models has no {model}") from error
    except KeyError as error:
        raise ValueError(f"drone: drone-models has no {drone}") from error
    finally:
        os.environ.pop(_SWITCH) if before is None else os.environ.update({_SWITCH: before})
    equations = module.symbolic_dynamics_euler
    arguments = signature(equations).parameters.values()
    names = [argument.name for argument in arguments if argument.kind is Parameter.KEYWORD_ONLY]
    rate, x, u, _ = equations(True, **{name: parameters[name] for name in names})
    return rate, x, u, parameters
