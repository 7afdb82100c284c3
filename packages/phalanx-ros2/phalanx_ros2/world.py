"""Robots over ROS 2, real or of any simulator, as a world in real time.

The state of a robot follows its declared dynamics, and is drawn within a time τ (`blend`) to where
its newest odometry and the inputs since then lead. So a robot that moves otherwise by e needs a
disturbance of about e/τ.
"""

import atexit
import math
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated, Any, Literal, NamedTuple

import casadi as ca
import numpy as np
from annotated_types import Ge

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.dynamics import Dynamics, weighted_rates
from phalanx.theory.models.world import Determinism, WorldAgent, WorldNote, WorldStates
from phalanx_ros2.robots import Robots

_EARLY = 0.1
"""Virtual time may be ahead of the wall clock by rounding and scheduling [s]."""
_LAST = 10
"""Commands to stop at the end: some may be lost."""
_KINDS = {
    ("x", "y", "theta"): ("nu", "omega"),
    ("x", "y"): ("vx", "vy"),
    ("x", "y", "vx", "vy"): ("ax", "ay"),
}
"""States and inputs of the declared dynamics that a planar robot can have."""


@dataclass(frozen=True)
class RobotTable:
    """Names and frames of a robot; {name} is its agent's, with _ for -."""

    odometry: str = "/agent_{name}/odom"
    """Topic of its pose."""
    odometry_type: Literal["Odometry", "PoseStamped"] = "Odometry"
    frame: str = "odom"
    """Frame of its pose; messages in another are dropped."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Pose of that frame in the scenario's coordinates: x, y [m], turn [rad]."""
    command: str = "/agent_{name}/cmd_vel"
    """Topic of its commanded velocity, in the robot's own axes."""
    command_type: Literal["Twist", "TwistStamped"] = "Twist"
    base: str = "base_link"
    """Frame of a TwistStamped."""

    def of(self, name: str) -> dict[str, Any]:
        """Return the table of an agent, with its name in the topics."""
        own = {"name": name.replace("-", "_")}
        topics = {"odometry": self.odometry.format(**own), "command": self.command.format(**own)}
        return {**vars(self), **topics}


@dataclass
class Ros2:
    """Robots that publish where they are, and take velocities."""

    robots: Mapping[str, RobotTable] = field(default_factory=dict)
    """By agent; others have the default."""
    router: str = "tcp/localhost:7447"
    """Zenoh endpoint of rmw_zenohd."""
    timeout: float = 10.0
    """Longest time to wait for the router, and for each robot's first odometry [s]."""
    input_timeout: float = 0.3
    """A robot without a new input for so long is commanded to stop [s]."""
    odometry_delay: Annotated[float, Ge(0)] = 0.0
    """Age of a pose when it arrives [s]."""
    odometry_timeout: float = 0.3
    """After so long without odometry no state is known: the run is not guaranteed [s]."""
    start_tolerance: float = 0.1
    """Largest difference of a robot's pose from its declared start [m, rad]."""
    blend: float = 0.2
    """τ [s]"""
    command_period: float = 0.05
    """Period of commands [s]."""
    dry_run: bool = False
    """Send nothing to the robots."""
    real_time = True

    @property
    def determinism(self) -> Determinism:
        """Nothing of a real robot repeats."""
        return "none"

    def require_robots(self, agents: Mapping[str, Dynamics]) -> None:
        """Raise ValueError unless all agents, by name, can be robots in the plane."""
        if unknown := self.robots.keys() - agents:
            raise ValueError(f"robots: expected names of agents, got {', '.join(sorted(unknown))}")
        for name, dynamics in agents.items():
            _require_planar(name, dynamics, self.robots.get(name, RobotTable()))

    def begin(self, agents: Sequence[WorldAgent], seed: int, step: float) -> None:
        """Meet all robots at their starts. Raises ValueError, RuntimeError."""
        tables = {a.name: self.robots.get(a.name, RobotTable()).of(a.name) for a in agents}
        self._link = Robots(self.router, tables, self.timeout)
        self._robots = {agent.name: _Robot(agent) for agent in agents}
        self._t, self._step, self._notes = 0.0, step, list[WorldNote]()
        self._lock, self._over, self._began = threading.Lock(), threading.Event(), 0.0
        self._commanding = threading.Thread(target=self._command, daemon=True)
        atexit.register(self.close)
        for name, robot in self._robots.items():
            self._require_start(name, robot)
        if self.dry_run:
            nothing = "dry run: nothing was sent to the robots"
            self._notes.append(WorldNote(0.0, nothing, "commands sent"))
        self._commanding.start()

    def reseed(self, seed: int) -> None:
        """Do nothing: robots draw nothing."""

    def hold(self, name: str, u: Array) -> None:
        """Make a robot hold u. Raises ValueError."""
        robot = self._robots.get(name)
        if robot is None or np.shape(u) != robot.u.shape or not np.isfinite(u).all():
            raise ValueError(f"expected a robot and its finite inputs, got {name}: {u}")
        with self._lock:
            robot.hold(np.zeros_like(u) if self.dry_run else np.array(u, dtype=float))
            if robot.stopped:
                robot.stopped = False
                self._notes.append(WorldNote(self._t, f"agent {name}: commanded again"))
            self._send(name, robot.velocity)

    def advance(self, until: float) -> WorldStates:
        """Return the states up to now, which is `until`. Raises ValueError."""
        if not self._t < until:
            raise ValueError(f"expected more than {self._t:g} s, got {until:g}")
        now = time.monotonic()
        self._began = self._began or now - until
        if until > now - self._began + _EARLY:
            raise ValueError("robots move by the wall clock: run it with --real-time 1")
        count = math.ceil((until - self._t) / self._step)
        times = np.linspace(self._t, until, count + 1)
        with self._lock:
            states = {name: self._followed(name, times, now) for name in self._robots}
            notes, self._notes = self._notes, []
        self._t = until
        return WorldStates(times[1:], states, notes)

    def close(self) -> None:
        """Stop all robots, and leave them."""
        atexit.unregister(self.close)
        if not self._over.is_set():
            self._over.set()
            if self._commanding.is_alive():
                self._commanding.join()  # or its last command would come after the stop
            for _ in range(_LAST):
                for name in self._robots:
                    self._send(name, np.zeros(3))
                time.sleep(self.command_period)
            self._link.close()

    def _require_start(self, name: str, robot: "_Robot") -> None:
        pose = self._link.first(name, self.timeout).pose
        if np.abs(robot.off(pose)).max() > self.start_tolerance:
            at = ", ".join(f"{value:.3f}" for value in pose)
            raise ValueError(
                f"agent {name}: its robot is at x, y, turn = {at}, more than start_tolerance from "
                "its start: move it there, or change start or origin"
            )

    def _followed(self, name: str, times: Array, now: float) -> Array:
        """Return a robot's states at times[1:], drawn to its odometry; now: of the last [s]."""
        robot, reading = self._robots[name], self._link.newest(name)
        late = now - reading.arrived > self.odometry_timeout
        if late != robot.lost:
            robot.lost = late
            what = f"no odometry for {self.odometry_timeout:g} s" if late else "odometry is back"
            fails = f"odometry of agent {name}" if late else ""
            self._notes.append(WorldNote(self._t, f"agent {name}: {what}", fails))
        dt = float(times[1] - times[0])
        weight = 0.0 if late else 1.0 - math.exp(-dt / self.blend)
        begin, states = now - float(times[-1] - times[0]), []
        there = (
            robot.x if late else robot.led(reading, reading.arrived - self.odometry_delay, begin)
        )
        for _ in times[1:]:
            robot.x, there = (robot.move(x, robot.u, dt) for x in (robot.x, there))
            robot.x = robot.x + weight * (there - robot.x)
            states.append(robot.x)
        robot.turn = float(reading.pose[2])
        return np.array(states)

    def _command(self) -> None:
        """Send each robot its velocity again and again; stop those whose input is late."""
        while not self._over.wait(self.command_period):
            with self._lock:
                for name, robot in self._robots.items():
                    self._watch(name, robot)
                    robot.integrate(self.command_period)
                    self._send(name, robot.velocity)

    def _watch(self, name: str, robot: "_Robot") -> None:
        since = robot.held[-1].since
        if not robot.stopped and since and time.monotonic() - since > self.input_timeout:
            robot.stop()
            text = f"agent {name}: no input for {self.input_timeout:g} s, commanded to stop"
            self._notes.append(WorldNote(self._t, text))

    def _send(self, name: str, velocity: Array) -> None:
        if not self.dry_run:
            self._link.send(name, velocity)


class _Held(NamedTuple):
    """An input that a robot was given."""

    since: float
    """On the monotonic clock [s]; 0 before the first."""
    u: Array


class _Robot:
    """A robot's state, and what it holds."""

    def __init__(self, agent: WorldAgent) -> None:
        dynamics = agent.dynamics
        self.x = np.array(agent.start, dtype=float)
        self.held = deque([_Held(0.0, np.zeros(len(dynamics.inputs)))])
        """The inputs since its newest pose."""
        self.turns, self.accelerates = "theta" in dynamics.states, len(dynamics.states) == 4
        self.turn = float(self.x[2]) if self.turns else 0.0
        self.stopped = self.lost = False
        self._v = self.x[2:] if self.accelerates else np.zeros(2)
        """Commanded velocity of a double integrator."""
        self.move = _step(dynamics)

    def off(self, pose: Array) -> Array:
        """Return the difference of a pose from the state: x, y, turn within ±π."""
        turn = math.remainder(pose[2] - self.x[2], math.tau) if self.turns else 0.0
        return np.array([*(pose[:2] - self.x[:2]), turn])

    @property
    def u(self) -> Array:
        """The input that it holds."""
        return self.held[-1].u

    def hold(self, u: Array) -> None:
        """Hold u from now on."""
        self.held.append(_Held(time.monotonic(), u))

    def led(self, reading: Any, begin: float, end: float) -> Array:
        """Return the state at `end` to which a pose at `begin` and the inputs since then lead."""
        while len(self.held) > 1 and self.held[1].since <= begin:
            self.held.popleft()
        x = self.nearest(reading)
        for (since, u), (until, _) in pairwise([*self.held, _Held(end, self.u)]):
            x = self.move(x, u, until - max(begin, since))
        return x

    def nearest(self, reading: Any) -> Array:
        """Return the state that odometry shows, its turn without a jump by 2π."""
        if self.turns:
            return self.x + self.off(reading.pose)
        state = np.concatenate([reading.pose[:2], reading.velocity])
        return np.asarray(state[: len(self.x)])

    def integrate(self, dt: float) -> None:
        """Move a double integrator's commanded velocity on."""
        if self.accelerates and not self.stopped:
            self._v = self.move(np.concatenate([np.zeros(2), self._v]), self.u, dt)[2:]

    def stop(self) -> None:
        """Command no velocity from now on."""
        self.stopped, self._v = True, np.zeros(2)
        self.hold(np.zeros_like(self.u))

    @property
    def velocity(self) -> Array:
        """The velocity to command, in the robot's axes: ahead, left [m/s], turn [rad/s]."""
        if self.turns:
            return np.array([self.u[0], 0.0, self.u[1]])
        x, y = self._v if self.accelerates else self.u
        c, s = math.cos(self.turn), math.sin(self.turn)
        return np.array([c * x + s * y, c * y - s * x, 0.0])


def _step(dynamics: Dynamics) -> Any:
    """Return the function (x, u, dt) -> x after a Runge-Kutta step of the declared dynamics."""
    x, u = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("u", len(dynamics.inputs))
    dt, still = ca.SX.sym("dt"), ca.SX.zeros(len(dynamics.states))
    field = ca.Function("f", [x, u], [dynamics.drift(x) + dynamics.actuation(x) @ u])
    after = x + dt / 6 * weighted_rates(field, x, u, (still, still, still), dt)
    function = CompiledFunction([x, u, dt], [after])
    return lambda *given: np.array(function(*given)[0])


def _require_planar(name: str, dynamics: Dynamics, table: RobotTable) -> None:
    states, inputs = tuple(dynamics.states), tuple(dynamics.inputs)
    if _KINDS.get(states) != inputs:
        raise ValueError(
            f"agent {name}: expected unicycle, or single-integrator or double-integrator "
            "with dimension = 2"
        )
    if len(states) == 4 and table.odometry_type != "Odometry":
        raise ValueError(f"robots.{name}.odometry_type: expected Odometry, for velocities")
