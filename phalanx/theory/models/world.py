"""A world: robots that move by other laws than the dynamics that their controllers know."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.user_methods import MistakenMethodError
from phalanx.theory.models.dynamics import Dynamics

Determinism = Literal["bits", "build", "none"]
"""Where the same seed and inputs give the same bits: anywhere, on one build and CPU, or nowhere."""
_LONGER = 1.0 + 1e-6
"""A step may be longer by rounding."""


class WorldError(RuntimeError):
    """A shipped world cannot start: its robots, a package or a field are missing or wrong."""


class WorldAgent(NamedTuple):
    """A robot of a world.

    >>> WorldAgent("a", SingleIntegrator(speed=1.0), start=np.zeros(2)).name
    'a'
    """

    name: str
    dynamics: Dynamics
    """The declared dynamics: the coordinates of states and inputs."""
    start: Array
    """State at t = 0, shape (n,)."""


class WorldNote(NamedTuple):
    """An event in a world, for the event log."""

    t: float
    """[s]"""
    text: str
    fails: str = ""
    """An assumption of the guarantee, by name, that fails with it."""


class WorldStates(NamedTuple):
    """States of all robots at s instants, in order.

    >>> WorldStates(np.array([0.1]), {"a": np.zeros((1, 2))}).x["a"].shape
    (1, 2)
    """

    t: Array
    """[s], shape (s,)"""
    x: Mapping[str, Array]
    """States of each robot by its name, shape (s, n)."""
    notes: Sequence[WorldNote] = ()
    """What else happened."""


@runtime_checkable
class World(Protocol):
    """A simulator of robots. A scenario names it in `world`; a dataclass with these members is one.

    `phalanx_testing.check_world` tries whether it keeps what is said here. A world whose attribute
    `real_time` is true runs in real time alone; a method `close()` is called after the run.
    `require_robots(dynamics)`, by agent, may raise ValueError of what cannot be its robots.

    >>> class Points:
    ...     determinism = "bits"
    ...     def begin(self, agents, seed, step):
    ...         self.t, self.step = 0.0, step
    ...         self.x = {a.name: a.start for a in agents}
    ...         self.u = {a.name: 0.0 * a.start for a in agents}
    ...     def reseed(self, seed): ...
    ...     def hold(self, name, u):
    ...         self.u[name] = u
    ...     def advance(self, until):
    ...         t = np.linspace(self.t, until, 2 + int((until - self.t) / self.step))[1:]
    ...         x = {n: self.x[n] + np.outer(t - self.t, u) for n, u in self.u.items()}
    ...         self.t, self.x = until, {n: path[-1] for n, path in x.items()}
    ...         return WorldStates(t, x)
    >>> world = Points()
    >>> world.begin([WorldAgent("a", SingleIntegrator(speed=1.0), np.zeros(2))], 0, 0.1)
    >>> world.hold("a", np.ones(2))
    >>> world.advance(0.1).x["a"][-1]
    array([0.1, 0.1])
    """

    @property
    def determinism(self) -> Determinism:
        """The extent to which the same seed and inputs give the same states."""

    def begin(self, agents: Sequence[WorldAgent], seed: int, step: float) -> None:
        """Put the robots at their states at t = 0, each holding a zero input.

        Args:
            agents: all robots.
            seed: of all that is random.
            step: longest time between two states that `advance` returns [s].
        """

    def reseed(self, seed: int) -> None:
        """Draw from another seed from now on. A world that draws nothing ignores it."""

    def hold(self, name: str, u: Array) -> None:
        """Make a robot hold the input u, shape (m,), from now on. Raises ValueError if it cannot.

        A name that is unknown, another shape and numbers that are not finite are refused.
        """

    def advance(self, until: float) -> WorldStates:
        """Move on to exactly `until` [s]; return states after now, the last one at `until`.

        Raises ValueError if `until` is not after now.
        """


def moves_by_itself(world: World | None) -> bool:
    """Return whether a world moves by the wall clock."""
    return bool(getattr(world, "real_time", False))


def require_clock(world: World | None, real_time: float | None) -> None:
    """Raise ValueError if a world moves by the wall clock, and the run does not."""
    if moves_by_itself(world) and real_time != 1.0:
        raise ValueError("world: its robots move by the wall clock: run it with --real-time 1")


def advanced(
    world: World, agents: Sequence[WorldAgent], now: float, until: float, step: float
) -> WorldStates:
    """Advance a world and check what it returns. Raises MistakenMethodError."""
    expected = f"states up to t = {until:.9g} s, at most {step:g} s apart"
    states: Any = world.advance(until)

    def mistaken(got: str) -> MistakenMethodError:
        return MistakenMethodError(world, "advance", expected, got)

    try:
        t = np.asarray(states.t, dtype=float)
        x = {a.name: np.asarray(states.x[a.name], dtype=float) for a in agents}
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise mistaken(f"no times t and states x of every agent: {error}") from error
    gaps = np.diff(t, prepend=now) if t.ndim == 1 else np.zeros(1)
    if not gaps.size or not (gaps > 0.0).all() or t[-1] != until:
        raise mistaken(f"times {t.ravel()[:3]} ... that do not rise to it")
    if gaps.max() > step * _LONGER:
        raise mistaken(f"a gap of {gaps.max():g} s")
    for agent in agents:
        shape = len(t), len(agent.dynamics.states)
        if x[agent.name].shape != shape:
            raise mistaken(f"shape {x[agent.name].shape} for agent {agent.name}, not {shape}")
    return WorldStates(t, x, getattr(states, "notes", ()))
