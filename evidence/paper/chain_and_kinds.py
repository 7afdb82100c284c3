"""What is composed from kinds of pairs, beside the chain of the whole swarm as one expression.

    python evidence/paper/chain_and_kinds.py [--states 1000] [--agents 8,16,32,64,128,256]

First the largest difference of all terms at random states of every shipped scenario: of h_tot with
everything seen and with neighbourhoods, and of each pair's row of the first normal agent. It is
relative to the number, or to 1 where that is larger. Then what both take to build.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from rich.console import Console
from rich.progress import track

from phalanx.arrays import Array, Index
from phalanx.scenario.load import load, shipped
from phalanx.seeded.draws import Draws
from phalanx.swarm.compile import compile_rows
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.margins.row_part import RowPart
from phalanx.theory.rows.pairs import PairTerms
from phalanx.theory.rows.terms import TermsAt, TermsFunction
from phalanx.theory.safety.composition import FAR

_JERKS = [
    'agents.0.dynamics={ type = "triple-integrator", jerk = 2.0, dimension = 3 }',
    'agents.1.dynamics={ type = "triple-integrator", jerk = 1.5, dimension = 3 }',
    'agents.0.law={ type = "track", gains = [1.0, 2.0, 2.0] }',
    'agents.1.law={ type = "chase", gains = [1.0, 2.0, 2.0] }',
    "safety.alpha=[0.4, 0.4, 0.4]",
]
_LSE = [
    "safety.composition=lse",
    "safety.margin=paper",
    "safety.eta=1.0",
    "safety.information=paper",
]
_EVERYTHING = 1e9
"""A neighbourhood that nobody is out of [m]."""
_NEAR = 0.6
"""Neighbourhoods are this share of the swarm's own size."""
_LONGEST = 5.0
"""An expression that takes longer to build [s] is not built for more agents."""


def main() -> None:
    """Print both tables."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--states", type=int, default=1000, help="of each scenario")
    arguments.add_argument("--agents", default="8,16,32,64,128,256")
    options = arguments.parse_args()
    print("| scenario | q | states | h_tot | h_tot, neighbourhood | rows of pairs |")
    print("|---|---|---|---|---|---|")
    cases: dict[str, list[str]] = {name: [] for name in shipped()}
    cases["formation3d, jerks"] = _JERKS
    for title in track(cases, console=Console(stderr=True)):
        print(compared(title, cases[title], options.states), flush=True)
    print("\n| agents | pairs | chain [s] | kinds [s] | rows of pairs [s] | terms [µs] |")
    print("|---|---|---|---|---|---|")
    still = True
    for count in map(int, options.agents.split(",")):
        line, still = built(count, still)
        print(line, flush=True)


def compared(title: str, overrides: Sequence[str], states: int) -> str:
    """One line of the first table."""
    name, *_ = title.split(",")
    whole = _rows(name, [*overrides, *_LSE, f"safety.neighbourhood={_EVERYTHING}"])
    alone = _rows(name, [*overrides, "safety.composition=pairs"])
    swarm = whole.swarm
    near = _rows(name, [*overrides, *_LSE, f"safety.neighbourhood={_NEAR * _size(swarm)}"])
    drawn = list(_states(swarm, states))
    largest = [
        max(map(difference, drawn))
        for difference in (_of_h_tot(whole), _of_h_tot(near), _of_pairs(alone))
    ]
    numbers = [f"{value:.1e}" for value in largest]
    return f"| {title} | {whole.relative_degree} | {states} | {' | '.join(numbers)} |"


def _rows(name: str, overrides: Sequence[str]) -> SafetyRows:
    return build_rows(build_swarm(load(name, list(overrides))))


def _size(swarm: Swarm) -> float:
    """How far from their middle agents are at the start, at least a few metres [m]."""
    points = swarm.positions(swarm.start())
    return max(5.0, float(np.linalg.norm(points - points.mean(axis=0), axis=1).max()))


def _states(swarm: Swarm, count: int) -> Iterator[Array]:
    """Around the start, from as far apart as agents are there to all on one heap."""
    start, size = swarm.start(), _size(swarm)
    names = [name for member in swarm.members for name in member.dynamics.states]
    spread = np.array([size if name in ("x", "y", "z") else 3.0 for name in names])
    draws = Draws(0, "chain and kinds", swarm.scenario.name, width=len(start))
    for k in range(count):
        yield (start + spread * (2.0 * draws[k] - 1.0)) / (1 + k % 7)


def _of_h_tot(rows: SafetyRows) -> Callable[[Array], float]:
    """x -> the largest difference of the first normal agent's terms of h_tot."""
    swarm, i = rows.swarm, rows.swarm.normal[0]
    radius = swarm.sensing(i)
    active = None if radius is None else swarm.safe_set.within(i, radius)
    margin = rows.margin(i).of(rows.chain, i, active=active)
    chain, kinds = TermsFunction(rows.chain, active, margin), rows.terms(i)

    def difference(x: Array) -> float:
        found, expected = kinds(x, swarm.seen(i, x)), chain(x)
        if found.psi[0] == FAR:  # nobody is near
            return 0.0
        worst = max(
            _relative(found.psi, expected.psi),
            _relative(found.unforced, expected.unforced),
            _relative(found.margin, expected.margin),
        )
        for l in found.c:
            worst = max(
                worst,
                _relative(found.c[l], expected.c[l]),
                _relative(found.positions[l], expected.positions[l]),
                _relative(found.least[l], expected.least[l]),
                _relative(found.most[l], expected.most[l]),
            )
        return worst

    return difference


def _of_pairs(rows: SafetyRows) -> Callable[[Array], float]:
    """x -> the largest difference of the first normal agent's rows, margins included."""
    swarm, i = rows.swarm, rows.swarm.normal[0]
    kinds = rows.pair_terms(i)
    pairs = swarm.pairs.of(i, range(len(swarm.members)))
    chains = [_chain_of_pair(rows, i, pair) for pair in pairs.tolist()]

    def difference(x: Array) -> float:
        worst = 0.0
        for sharing in ((), swarm.normal):
            found = kinds(x, sharing=sharing)
            where = {other: k for k, other in enumerate(found.beside)}
            for pair in chains:
                if pair.other in where:  # else an obstacle that is too far away
                    worst = max(worst, pair.difference(found, where[pair.other], x))
        return worst

    return difference


class _Reference(NamedTuple):
    """One pair of an agent, by its own chain."""

    other: int
    states: Index
    """Where the pair's state lies in that of the swarm."""
    own: int
    chain: TermsFunction
    half: CompiledFunction
    """x -> the margin of its half; 0 if it is not shared."""

    def difference(self, found: PairTerms, k: int, x: Array) -> float:
        """Of the k-th row."""
        expected = self.chain(x[self.states])
        most = 0.0 if len(expected.most) == 1 else expected.most[1 - self.own]
        margin = expected.margin
        if found.parts[k] is RowPart.HALF:
            margin = float(self.half(x[self.states])[0][0])
        return max(
            _relative(found.psi[k], expected.psi),
            _relative(found.unforced[k], expected.unforced),
            _relative(found.a[k], expected.c[self.own]),
            _relative(found.most[k], most),
            _relative(found.margin[k], margin),
        )


def _chain_of_pair(rows: SafetyRows, i: int, ends: list[int]) -> _Reference:
    swarm = rows.swarm
    composed, members = swarm.safe_set, len(swarm.members)
    number = swarm.pairs.among(range(members)).tolist().index(ends)
    chain, own, margin = rows.pair_chain(number), ends.index(i), rows.margin(i)
    other = ends[1 - own]
    half = margin.of(chain, own, RowPart.HALF) if other in swarm.normal else ca.SX(0)
    states = np.concatenate([np.r_[composed.parts[l]] for l in ends if l < members])
    whole = TermsFunction(chain, margin=margin.of(chain, own))
    return _Reference(other, states, own, whole, CompiledFunction([chain.set.x], [half]))


def _relative(found: Array | float, expected: Array | float) -> float:
    a, b = np.asarray(found), np.asarray(expected)
    # Where no margin is known both are infinite.
    with np.errstate(invalid="ignore"):
        apart = np.abs(a - b) / np.maximum(1.0, np.abs(b))
    return float(np.where(a == b, 0.0, apart).max())


def built(count: int, still: bool) -> tuple[str, bool]:
    """One line of the second table, and whether the chain can be built for more agents."""
    adversaries = count // 8
    of_group = [f"agents.0.count={count - adversaries}", f"agents.1.count={adversaries}"]
    began = time.perf_counter()
    rows = _rows("swarm", [*of_group, *_LSE])
    i = rows.swarm.normal[0]
    x, terms = rows.swarm.start(), rows.terms(i)
    seen = rows.swarm.seen(i, x)
    terms(x, seen)
    kinds = time.perf_counter() - began
    step = min(_timed(terms, x, seen) for _ in range(200))
    began = time.perf_counter()
    compile_rows(_rows("swarm", of_group))
    pairs = time.perf_counter() - began
    chain = np.inf
    if still:
        began = time.perf_counter()
        TermsFunction(rows.chain)(x)
        chain = time.perf_counter() - began
    shown = f"{chain:.2f}" if still else "-"
    many = len(rows.swarm.safe_set.pairs)
    line = f"| {count} | {many} | {shown} | {kinds:.2f} | {pairs:.2f} | {step * 1e6:.0f} |"
    return line, chain < _LONGEST / 8


def _timed(terms: TermsAt, x: Array, seen: Sequence[int]) -> float:
    began = time.perf_counter()
    terms(x, seen)
    return time.perf_counter() - began


if __name__ == "__main__":
    main()
