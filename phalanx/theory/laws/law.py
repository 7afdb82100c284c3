"""Protocols of what makes an agent's input: nominal laws, attacks, and controllers.

Laws of normal agents and attacks of adversaries compute an input before it is made safe or
projected onto U_i. A controller takes the place of the paper's filter in normal agents whose group
names it. The run judges its inputs like all others, from the true state and the applied input.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from msgspec import Struct

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.expressions.user_methods import MistakenMethodError, first_numbers
from phalanx.theory.laws.goals import Goal
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.pairs import PairTerms
from phalanx.theory.rows.row import Terms
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.composition import Member
from phalanx.theory.safety.function import SafeSetFunction, Static
from phalanx.theory.safety.obstacles import Obstacle

StateBox = tuple[Array, Array]
"""Least and largest (p, v) of an agent's output point, shapes (2 axes,) [m, m/s]."""


class View(Struct, frozen=True):
    """A law's arguments at one sampling instant of agent i: its own state and those it sees.

    >>> goal = Goal(np.ones(2), np.zeros(2), np.zeros(2))
    >>> View(0, {0: np.zeros(2)}, (0,), goal, None, t=0.0).goal.position
    array([1., 1.])
    """

    i: int
    x: Mapping[int, Array]
    """States by agent's index, agent i's among them."""
    normal: Sequence[int]
    """Indices of the normal agents that it sees, itself included if it is one."""
    goal: Goal
    terms: Terms
    t: float
    """Time of the sample [s]."""
    age: Mapping[int, float] = {}
    """Of each peer by radio, time since what is known of it was sampled [s]."""
    boxes: Callable[[], Mapping[int, StateBox]] = dict

    @property
    def positions(self) -> Mapping[int, Array]:
        """Output positions by agent's index [m]."""
        return self.terms.positions

    @property
    def box(self) -> Mapping[int, StateBox]:
        """Boxes in which peers by radio are, each with the state in x in the middle."""
        return self.boxes()


@runtime_checkable
class Law(Protocol):
    """A nominal law or an attack; a scenario names it ``package.module:Name``.

    >>> class Still:
    ...     def prepare(self, dynamics):
    ...         self.u = np.zeros(len(dynamics.inputs))
    ...     def input(self, view):
    ...         return self.u
    >>> isinstance(Still(), Law)
    True
    """

    def prepare(self, dynamics: Dynamics) -> None:
        """Prepare for a dynamics; called once, before the first input.

        Raises ValueError if the law does not fit the dynamics.
        """

    def input(self, view: View) -> Array:
        """The nominal input, shape (m_i,)."""


@runtime_checkable
class TeamLaw(Protocol):
    """A law that needs the swarm before its first input.

    >>> isinstance(Chase(gains=(1.0,)), TeamLaw)
    True
    """

    def join(self, i: int, members: Sequence[Member], obstacles: Sequence[Obstacle]) -> Law:
        """The law of agent i. Called once, after prepare. Raises ValueError if it does not fit."""


_FLOAT = np.dtype(np.float64)


class CheckedInput:
    """The inputs of one agent's law or controller, checked, since it may be a user's own."""

    def __init__(self, of: "Law | Controller", member: Member) -> None:
        """Take the law or controller whose inputs these are, and the agent, a member."""
        self._of, self._agent, self._size = of, member.name, len(member.dynamics.inputs)

    def __call__(self, view: Any) -> Array:
        """The input for a view, as its protocol has it, shape (m_i,).

        Raises:
            MistakenMethodError: a user's class returned something else, raised, or does not return.
        """
        try:
            u: Any = self._of.input(view)
        except MistakenMethodError as error:
            error.name_agent(self._agent)
            raise
        # The usual case, decided in a fraction of a microsecond.
        usual = type(u) is np.ndarray and u.dtype is _FLOAT and u.shape == (self._size,)
        if usual and sum(map(abs, u.tolist())) <= LARGEST:
            array: Array = u
            return array
        if not isinstance(u, np.ndarray):
            got = repr(u)
        elif u.shape != (self._size,) or u.dtype.kind not in "fi":
            got = f"shape {u.shape} of {u.dtype}"
        elif not (np.abs(u) <= LARGEST).all():
            got = first_numbers(u)
        else:
            return u
        expected = f"a numpy array of {self._size} finite numbers for agent {self._agent}"
        raise MistakenMethodError(self._of, "input", expected, got)


MOST_NOTES, LONGEST_NAME = 32, 40
"""Most notes of a sample, and characters of their names."""


@dataclass(frozen=True)
class ControlledAgent:
    """The agent that a controller serves, and the swarm around it: what is known before a run.

    >>> robot = Member("a", SingleIntegrator(speed=1.0), False)
    >>> ControlledAgent(0, [robot], (), None, (), 0.02, 0.02, None, seed=0).dynamics.inputs
    ('vx', 'vy')
    """

    i: int
    """The agent's index."""
    members: Sequence[Member]
    """All agents in order: name, dynamics, and whether an adversary."""
    static: Sequence[Static]
    """Obstacles and limits."""
    function: SafeSetFunction
    """h of pairs."""
    alpha: Sequence[ClassK]
    """α_1 ... α_q of the scenario."""
    period: float
    """Γ_i: nominal time between two samples [s]."""
    longest: float
    """τ = Γ_i + δ_i^max and the latency: the longest that an input is in force [s]."""
    sensing: float | None
    """How far the agent sees [m]; None if it has no limit."""
    seed: int
    """The run's seed, for controllers with random numbers of their own."""

    @property
    def dynamics(self) -> Dynamics:
        """The agent's own dynamics."""
        return self.members[self.i].dynamics


class Received(NamedTuple):
    """The newest broadcast that the agent has received from another normal agent.

    >>> Received(u=np.ones(2), age=0.02).age
    0.02
    """

    u: Array
    """The input that the sender says it applies, shape (m_l,)."""
    age: float
    """Time since it took effect, at the agent's sample [s]; negative if it is yet to."""


@dataclass(frozen=True)
class ControllerView:
    """One agent's knowledge at a sample. Agents go by their index in the swarm.

    >>> goal = Goal(np.ones(2), np.zeros(2), np.zeros(2))
    >>> view = ControllerView(
    ...     0.0, 0, {}, (0,), goal, np.ones(2), {}, None, None, None, None, None, {}
    ... )
    >>> Nominal().input(view)
    array([1., 1.])
    """

    t: float
    """Time of the sample [s]."""
    i: int
    """The agent's own index."""
    x: Mapping[int, Array]
    """States of the agents in sight, its own among them."""
    normal: Sequence[int]
    """The normal agents in sight, itself included."""
    goal: Goal
    u_nom: Array
    """The input that the scenario's nominal law wants, shape (m_i,)."""
    received: Mapping[int, Received]
    """By sender, in sight or not."""
    inputs: Polytope
    """U_i at the sampled state, {u : A u <= b}."""
    terms: Terms
    """Terms of h_tot, all pairs in sight composed."""
    _pairs: Callable[[], PairTerms]
    _nearest: Callable[[Array], Array]
    _certified: Callable[[Array], float]
    _notes: dict[str, float]
    age: Mapping[int, float] = field(default_factory=dict)
    """Of each peer by radio, time since what is known of it was sampled [s]."""
    _boxes: Callable[[], Mapping[int, StateBox]] = dict

    @property
    def positions(self) -> Mapping[int, Array]:
        """Output positions of the agents in sight [m]."""
        return self.terms.positions

    @property
    def box(self) -> Mapping[int, StateBox]:
        """Boxes in which peers by radio are."""
        return self._boxes()

    @cached_property
    def pairs(self) -> PairTerms:
        """Each of the agent's own pairs in sight apart, with a margin of 0.

        ψ_q of a pair is a u_i + unforced + forces u_l, where l is the other member.
        """
        return self._pairs()

    def nearest(self, u: Array) -> Array:
        """The input of U_i nearest to another by the dynamics' metric, shapes (m_i,)."""
        return self._nearest(u)

    def certified(self, u: Array) -> float:
        """Time for which all its pairs in sight are proven safe if it holds an input [s].

        It is the verdict's certificate at the sampled state, for all inputs of the others, as if
        the input took effect at once. In the check before a run it is 0.

        Args:
            u: shape (m_i,).
        """
        return self._certified(u)

    def note(self, **numbers: float) -> None:
        """Record numbers of this sample, as columns ``note.<name>`` of `Run.inputs`.

        Raises ValueError if there are more than 32, a name has more than 40 characters or others
        than ASCII's, or a number is not finite.
        """
        for name, number in numbers.items():
            if len(name) > LONGEST_NAME or not name.isascii():
                raise ValueError(f"note: expected at most {LONGEST_NAME} ASCII letters, got {name}")
            if not abs(number) <= LARGEST:
                raise ValueError(f"note: expected a finite number, got {name} = {number}")
            self._notes[name] = float(number)
        if len(self._notes) > MOST_NOTES:
            raise ValueError(f"note: expected at most {MOST_NOTES}, got {len(self._notes)}")


@runtime_checkable
class Controller(Protocol):
    """The maker of an agent's inputs from its samples; a scenario names it ``package.module:Name``.

    Each agent has an object of its own, which may keep state in its attributes. A restarted agent
    gets a new one.

    >>> class Careful:
    ...     def prepare(self, agent):
    ...         self.u = np.zeros(len(agent.dynamics.inputs))
    ...     def input(self, view):
    ...         return view.u_nom if view.certified(view.u_nom) > 0.1 else self.u
    >>> isinstance(Careful(), Controller)
    True
    """

    def prepare(self, agent: ControlledAgent) -> None:
        """Prepare for an agent; called once, before its first input.

        Raises ValueError if the controller does not fit the agent.
        """

    def input(self, view: ControllerView) -> Array:
        """Return the agent's input, shape (m_i,); outside U_i it is projected onto U_i."""
