"""Wheeled robots with mass in MuJoCo: they accelerate by friction, slip, and may collide.

A driver aboard turns the held input into the wheels' torques. It knows mass and inertia as built,
and how fast the wheels turn; it does not know what fails.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, Literal, NamedTuple

import casadi as ca
import numpy as np
from annotated_types import Ge

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.dynamics import Dynamics, Positive
from phalanx.theory.models.world import Determinism, WorldAgent, WorldNote, WorldStates
from phalanx_worlds.rover import TRACK, WHEEL_RADIUS, WHEELS, swarm_model

_POSE = "x", "y", "theta"
_STATES = _POSE, (*_POSE, "nu", "omega")
"""States of the declared dynamics that such a robot can have."""
_DOFS = 8
"""Degrees of freedom of a robot: six of its hull, one of each wheel."""
_SUBSTEP = 5e-4
"""Longest step of MuJoCo [s]."""
_SETTLING = 400
"""Steps at rest before the start."""
_BRAKE = 1e3
"""Torque that a stuck wheel withstands [N m]."""


@dataclass(frozen=True)
class Failure:
    """A failure of a robot, which its driver does not know of."""

    at: Annotated[float, Ge(0)]
    """[s]"""
    agent: str
    mass: Positive = 1.0
    """Its hull's mass is multiplied by this."""
    wheel: Literal["none", "left", "right"] = "none"
    """A wheel that sticks."""

    def __str__(self) -> str:
        """Return it as a sentence."""
        what = [f"mass times {self.mass:g}"] * (self.mass != 1.0)
        what += [f"{self.wheel} wheel stuck"] * (self.wheel != "none")
        return f"agent {self.agent}: {', '.join(what) or 'nothing fails'}"


@dataclass
class Mujoco:
    """Robots with two driven wheels, in the coordinates of `dynamic-unicycle` or `unicycle`."""

    mass: Positive = 10.0
    """Of each robot [kg]."""
    friction: Positive = 1.0
    """Coefficient of friction of the wheels on the ground."""
    rolling: Annotated[float, Ge(0)] = 0.0
    """Rolling resistance of each wheel [N m], which the driver does not know."""
    lag: Positive = 0.05
    """Time constant in which wheels reach their rates, if inputs are velocities [s]."""
    failures: tuple[Failure, ...] = ()

    @property
    def determinism(self) -> Determinism:
        """MuJoCo's results depend on its build and the CPU's instructions."""
        return "build"

    def require_robots(self, agents: Mapping[str, Dynamics]) -> None:
        """Raise ValueError unless all agents, by name, have such states, and only they fail."""
        if unknown := {failure.agent for failure in self.failures} - agents.keys():
            raise ValueError(
                f"failures: expected names of agents, got {', '.join(sorted(unknown))}"
            )
        for name, dynamics in agents.items():
            if tuple(dynamics.states) not in _STATES:
                expected = "dynamics with states of dynamic-unicycle or unicycle"
                raise ValueError(f"agent {name}: expected {expected}")

    def begin(self, agents: Sequence[WorldAgent], seed: int, step: float) -> None:
        """Build the robots, and start them upright. Raises ValueError."""
        names = [agent.name for agent in agents]
        self._mujoco: Any = import_module("mujoco")  # which takes a while
        text = swarm_model(names, self.mass, self.friction, self.rolling)
        self._model = self._mujoco.MjModel.from_xml_string(text)
        self._data = self._mujoco.MjData(self._model)
        self._model.opt.timestep, self._t, self._step = _SUBSTEP, 0.0, step
        self._mujoco.mj_forward(self._model, self._data)
        inertia = np.zeros((self._model.nv, self._model.nv))
        self._mujoco.mj_fullM(self._model, self._data, inertia)
        rates = {id(agent.dynamics): _rate(agent) for agent in agents}
        self._robots = {
            agent.name: _Robot(agent, k, inertia, rates[id(agent.dynamics)], self.lag)
            for k, agent in enumerate(agents)
        }
        # Contacts carry the weight before the robots move.
        self._mujoco.mj_step(self._model, self._data, _SETTLING)
        self._data.qvel[:] = 0.0
        for agent, robot in zip(agents, self._robots.values(), strict=True):
            robot.put(self._data, np.asarray(agent.start, dtype=float))
        self._ahead = sorted(self.failures, key=lambda failure: failure.at)

    def reseed(self, seed: int) -> None:
        """Do nothing: no robot draws."""

    def hold(self, name: str, u: Array) -> None:
        """Make a robot's driver hold u. Raises ValueError."""
        robot = self._robots.get(name)
        if robot is None or np.shape(u) != robot.u.shape or not np.isfinite(u).all():
            raise ValueError(f"expected a robot and its finite inputs, got {name}: {u}")
        robot.u = np.array(u, dtype=float)

    def advance(self, until: float) -> WorldStates:
        """Move on, and let fail what fails in between. Raises ValueError."""
        if not self._t < until:
            raise ValueError(f"expected more than {self._t:g} s, got {until:g}")
        parts, notes = list[WorldStates](), list[WorldNote]()
        while self._t < until:
            while self._ahead and self._ahead[0].at <= self._t:
                failure = self._ahead.pop(0)
                self._fail(failure)
                notes.append(WorldNote(self._t, str(failure)))
            parts.append(self._moved(min([until, *(failure.at for failure in self._ahead[:1])])))
        states = {name: np.concatenate([part.x[name] for part in parts]) for name in self._robots}
        return WorldStates(np.concatenate([part.t for part in parts]), states, notes)

    def _moved(self, until: float) -> WorldStates:
        count = math.ceil((until - self._t) / self._step * (1.0 - 1e-9))
        times = np.linspace(self._t, until, count + 1)
        dt = (until - self._t) / count
        substeps = math.ceil(dt / _SUBSTEP * (1.0 - 1e-9))
        self._model.opt.timestep = dt / substeps
        states: dict[str, list[Array]] = {name: [] for name in self._robots}
        for _ in range(count):
            for robot in self._robots.values():
                robot.drive(self._data)
            self._mujoco.mj_step(self._model, self._data, substeps)
            for name, robot in self._robots.items():
                states[name].append(robot.state(self._data))
        self._t = until
        return WorldStates(times[1:], {name: np.array(x) for name, x in states.items()})

    def _fail(self, failure: Failure) -> None:
        model = self._model
        hull = model.body(failure.agent).id
        model.body_mass[hull] *= failure.mass
        model.body_inertia[hull] *= failure.mass
        self._mujoco.mj_setConst(model, self._mujoco.MjData(model))
        if failure.wheel != "none":
            wheel = _DOFS * list(self._robots).index(failure.agent) + 6
            model.dof_frictionloss[wheel + WHEELS.index(failure.wheel)] = _BRAKE


class _Built(NamedTuple):
    """Mass and inertia that a driver knows, those of turning wheels included."""

    mass: float
    """[kg]"""
    inertia: float
    """[kg m²]"""


class _Robot:
    """A robot's place in MuJoCo's arrays, and its driver."""

    def __init__(
        self, agent: WorldAgent, k: int, inertia: Array, rate: CompiledFunction, lag: float
    ) -> None:
        """k: its number. inertia: of all robots at rest, shape (8 N, 8 N)."""
        self.u = np.zeros(len(agent.dynamics.inputs))
        self._rate, self._lag, self._n = rate, lag, len(agent.dynamics.states)
        # A free joint and two hinges have nine coordinates.
        self._q, self._v = 9 * k, _DOFS * k
        mass, turn, wheel = (inertia[self._v + dof, self._v + dof] for dof in (0, 5, 6))
        spun = 2.0 * wheel / WHEEL_RADIUS**2
        self._built = _Built(mass + spun, turn + spun * (TRACK / 2) ** 2)
        self._theta = float(agent.start[2])

    def put(self, data: Any, x: Array) -> None:
        """Put the robot at x, its wheels rolling."""
        nu, omega = x[3:] if self._n == 5 else (0.0, 0.0)
        theta = float(x[2])
        c, s = math.cos(theta), math.sin(theta)
        q, v = self._q, self._v
        data.qpos[q : q + 2] = x[:2]
        data.qpos[q + 3 : q + 7] = math.cos(theta / 2), 0.0, 0.0, math.sin(theta / 2)
        data.qvel[v : v + 2] = nu * c, nu * s
        data.qvel[v + 5] = omega
        across = omega * TRACK / 2
        data.qvel[v + 6 : v + 8] = (nu - across) / WHEEL_RADIUS, (nu + across) / WHEEL_RADIUS

    def drive(self, data: Any) -> None:
        """Set the wheels' torques for the held input and the wheels' rates."""
        v_left, v_right = WHEEL_RADIUS * data.qvel[self._v + 6 : self._v + 8]
        nu, omega = (v_left + v_right) / 2, (v_right - v_left) / TRACK
        if self._n == 5:
            rate = self._rate(np.array([0.0, 0.0, 0.0, nu, omega]), self.u)[0]
            a, alpha = rate[3], rate[4]
        else:
            rate = self._rate(np.zeros(3), self.u)[0]
            a, alpha = (rate[0] - nu) / self._lag, (rate[2] - omega) / self._lag
        force, turn = self._built.mass * a / 2, self._built.inertia * alpha / TRACK
        torques = WHEEL_RADIUS * (force - turn), WHEEL_RADIUS * (force + turn)
        data.qfrc_applied[self._v + 6 : self._v + 8] = torques

    def state(self, data: Any) -> Array:
        """Return the state in the declared coordinates; θ does not jump."""
        w, i, j, k = data.qpos[self._q + 3 : self._q + 7]
        ahead = 1.0 - 2.0 * (j * j + k * k), 2.0 * (w * k + i * j)
        theta = math.atan2(ahead[1], ahead[0])
        self._theta += math.remainder(theta - self._theta, math.tau)
        vx, vy, _, *turn = data.qvel[self._v : self._v + 6]
        # Third row of the rotation: the turn about the vertical.
        upright = 2.0 * (i * k - w * j), 2.0 * (j * k + w * i), 1.0 - 2.0 * (i * i + j * j)
        omega = sum(axis * rate for axis, rate in zip(upright, turn, strict=True))
        x, y = data.qpos[self._q : self._q + 2]
        nu = vx * math.cos(theta) + vy * math.sin(theta)
        return np.array([x, y, self._theta, nu, omega][: self._n])


def _rate(agent: WorldAgent) -> CompiledFunction:
    """Return the function (x, u) -> x' of an agent's declared dynamics."""
    dynamics: Dynamics = agent.dynamics
    x, u = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("u", len(dynamics.inputs))
    return CompiledFunction([x, u], [dynamics.drift(x) + dynamics.actuation(x) @ u])
