"""Terms of h_tot at a sampled state, composed from the pairs that an agent sees.

The cost does not grow with the swarm: only pairs in sight are evaluated, kind by kind.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import BoundFunction, CompiledFunction
from phalanx.theory.models.polytope import Polytope, extremes, polytope
from phalanx.theory.rows.by_jets import TermsByJets
from phalanx.theory.rows.members import Positions, SwarmMembers
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.jets import LogSumExpJets
from phalanx.theory.safety.kinds import with_symbols
from phalanx.theory.safety.pairs import ChosenPairs, SwarmPairs


class SwarmTerms:
    """Compiled functions for the terms of all agents of a swarm."""

    def __init__(self, pairs: SwarmPairs, rho: float, alphas: Sequence[ClassK], xi: float) -> None:
        """alphas: α_1 ... α_q. xi: of Eq. (xi).

        Raises EmptyPolytopeError: a constant input polytope is empty or unbounded.
        """
        self.pairs, shared = pairs, pairs.functions.get
        self.members = shared("members", lambda: SwarmMembers(pairs.members, len(pairs.parameters)))
        self.jets = shared("jets", lambda: LogSumExpJets(rho, alphas, xi))
        self.by_jets = shared(
            ("terms", pairs.adversaries),
            lambda: TermsByJets(pairs.kinds, self.members, self.jets),
        )
        self.numbers: Array = np.concatenate(
            [np.zeros(pairs.states), pairs.parameters, self.members.corners]
        )
        """Arguments of its functions: the state, obstacles' parameters, and corners of each U."""
        self.everyone = tuple(range(len(pairs.members)))

    def of(self, i: int, radius: float | None, margin: float = 0.0) -> "ComposedTerms":
        """Agent i's terms.

        Args:
            i: the agent.
            radius: how far it sees obstacles [m]; None for all.
            margin: η of its row.
        """
        return ComposedTerms(self, i, radius, margin)

    def obstacles_within(self, i: int, radius: float | None) -> CompiledFunction | None:
        """(x_i, parameters of all obstacles) -> 1 for each within the radius [m], else 0.

        None if all of them count.
        """
        if radius is None or not self.pairs.obstacles:
            return None
        key = "obstacles within", self.members.kind_of[i], radius
        return self.pairs.functions.get(key, partial(self._compile_within, i, radius))

    def _compile_within(self, i: int, radius: float) -> CompiledFunction:
        dynamics = self.pairs.members[i].dynamics
        x = ca.SX.sym("x", len(dynamics.states))
        p = dynamics.position(x)
        obstacles, parameters = zip(*map(with_symbols, self.pairs.obstacles), strict=True)
        near = [obstacle.distance(p) <= radius for obstacle in obstacles]
        return CompiledFunction([x, ca.vertcat(*parameters)], [ca.vertcat(*near)])


class _ComposedFunction:
    """Terms of fixed pairs and members, whose numbers it reads by tables of indices."""

    def __init__(
        self, by_jets: TermsByJets, numbers: Array, in_sight: Sequence[int], pairs: ChosenPairs
    ) -> None:
        """Choose the function.

        Args:
            by_jets: the functions.
            numbers: any state, the obstacles' parameters and the corners of each U.
            in_sight: members.
            pairs: among them, and with obstacles and limits.
        """
        members, self._degree = by_jets.members, by_jets.jets.degree
        kinds = list(members.by_kind(in_sight).items())
        sizes = [(members.kinds[k].inputs, group) for k, group in kinds]
        self._c, end = by_jets.layout(sizes, self._degree + 1)
        sizes = [(members.kinds[k].extremes.results, group) for k, group in kinds]
        self._ends, _ = by_jets.layout(sizes, end)
        self._constant = members.constant_polytopes
        self._varying = [l for l in self._ends if l not in self._constant]
        self._least = [(l, group.start) for l, group in self._ends.items() if l in self._constant]
        """(member, index of its least result) where U is constant; the most comes next."""
        function, tables = by_jets.function(kinds, pairs)
        # CasADi gathers by indices in float64, which it rounds.
        arguments = [table.ravel().astype(np.float64) for table in tables]
        self._bound = BoundFunction(function, [numbers.copy(), *arguments])
        (self._results,) = self._bound.outputs
        self._x = self._bound.inputs[0][: members.states[-1].stop]

    def __call__(self, x: Array) -> dict[str, Any]:
        """Evaluate at the stacked state, shape (n̄,); terms by name, as Terms has them."""
        self._x[:] = x
        self._bound.call()
        results, q = self._results.copy(), self._degree
        numbers = results.tolist()
        terms: dict[str, Any] = {
            "psi": results[:q],
            "unforced": numbers[q],
            "c": {l: results[part] for l, part in self._c.items()},
            "least": {l: numbers[k] for l, k in self._least},
            "most": {l: numbers[k + 1] for l, k in self._least},
            "polytopes": self._constant,
        }
        if self._varying:
            self._solve(terms, results)
        return terms

    def psi(self, x: Array) -> Array:
        """ψ_0 ... ψ_{q-1} alone, shape (q,), without any linear program."""
        self._x[:] = x
        self._bound.call()
        return self._results[: self._degree].copy()

    def _solve(self, terms: dict[str, Any], results: Array) -> None:
        """Add the linear programs of members whose U_l depends on the state."""
        terms["polytopes"] = dict(self._constant)
        for l in self._varying:
            row, c = results[self._ends[l]], terms["c"][l]
            A, b = np.split(row, [len(row) * len(c) // (len(c) + 1)])
            terms["polytopes"][l] = U = polytope(A.reshape(len(b), -1), b)
            terms["least"][l], terms["most"][l] = extremes(c, U.corners)


class ComposedTerms:
    """One agent's terms of h_tot at any state."""

    def __init__(self, swarm: SwarmTerms, i: int, radius: float | None, margin: float) -> None:
        self.swarm, self.margin = swarm, margin
        self._own_state = swarm.members.states[i]
        self.near = swarm.obstacles_within(i, radius)
        self._key: tuple[tuple[int, ...], bytes] | None = None
        self._function: _ComposedFunction
        self._members: tuple[int, ...] = ()
        self._positions = Positions(swarm.members, ())
        constant = len(swarm.members.constant_polytopes) == len(swarm.members.states)
        self.constant_polytopes = swarm.members.constant_polytopes if constant else None
        """U_l of all members; None if some depend on the state."""

    def __call__(self, x: Array, in_sight: Sequence[int] | None = None) -> "LazyTerms":
        """Evaluate at a stacked state, shape (n̄,), of which only members in sight are known.

        Args:
            x: anything for members out of sight. It is read on first use of a term.
            in_sight: in ascending order; None for all.
        """
        return LazyTerms(self, x, self.swarm.everyone if in_sight is None else tuple(in_sight))

    def compile(self) -> None:
        """Compile the function of all members now, and not at the first state."""
        states = self.swarm.members.states
        self.choose(np.zeros(states[-1].stop), self.swarm.everyone)

    def positions(self, x: Array, in_sight: tuple[int, ...]) -> Mapping[int, Array]:
        """Output positions of the members in sight [m]."""
        if in_sight != self._members:
            self._members, self._positions = in_sight, Positions(self.swarm.members, in_sight)
        return self._positions(x)

    def psi(self, x: Array, in_sight: Sequence[int] | None = None) -> Array:
        """ψ_0 ... ψ_{q-1} alone, shape (q,)."""
        return self.choose(x, self.swarm.everyone if in_sight is None else tuple(in_sight)).psi(x)

    def choose(self, x: Array, in_sight: tuple[int, ...]) -> _ComposedFunction:
        """The function of the pairs in sight at x."""
        pairs = self.swarm.pairs
        near = self.near(x[self._own_state], pairs.parameters)[0] if self.near else None
        # The same are in sight for many samples, and to choose takes longer than to evaluate.
        key = in_sight, b"" if near is None else near.tobytes()
        if self._key != key:
            around = None if near is None else np.flatnonzero(near).tolist()
            chosen = pairs.choose(pairs.among(in_sight, around))
            self._key, terms = key, self.swarm
            self._function = _ComposedFunction(terms.by_jets, terms.numbers, in_sight, chosen)
        return self._function


class LazyTerms:
    """One agent's Terms at one state, computed on first use: rows of pairs need few of them."""

    psi: Array
    unforced: float
    c: Mapping[int, Array]
    least: Mapping[int, float]
    most: Mapping[int, float]
    polytopes: Mapping[int, Polytope]
    positions: Mapping[int, Array]

    def __init__(self, terms: ComposedTerms, x: Array, in_sight: tuple[int, ...]) -> None:
        self._terms, self._x, self._members = terms, x, in_sight
        self.margin = terms.margin
        if terms.constant_polytopes is not None:
            self.polytopes = terms.constant_polytopes

    def __getattr__(self, name: str) -> Any:
        """Compute a term that is missing, with those that are computed in the same call."""
        if name not in LazyTerms.__annotations__:
            raise AttributeError(f"terms have no {name!r}")
        terms, x, in_sight = self._terms, self._x, self._members
        if name == "positions":
            self.positions = terms.positions(x, in_sight)
        else:
            vars(self).update(terms.choose(x, in_sight)(x))
        return vars(self)[name]
