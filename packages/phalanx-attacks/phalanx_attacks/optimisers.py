"""Optimisers of a search: each asks for the costs of a whole generation at once.

An optimiser is a function that goes on until the search raises. A generation is a batch, so any
number of workers gives the same path; on another CPU it may differ, as it depends on LAPACK.
"""

import warnings
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from cmaes import CatCMAwM

from phalanx.network.draws import Draws
from phalanx_attacks.knobs import Point, Space

_STALE = 8
"""Generations without a better point, after which a search begins again elsewhere."""
_SIGMA = 0.3
"""First step of CMA-ES, in a cube of side 1."""


class Evaluator(Protocol):
    """The search, as its optimiser uses it."""

    def costs(self, points: Sequence[Point]) -> list[float]:
        """Evaluate a generation, and return a cost for each: less is a better attack."""

    def next_target(self) -> None:
        """Begin again: from now on costs are of another target."""


Optimiser = Callable[[Space, Evaluator, int, "int | None"], None]
"""(space, evaluator, seed, batch) -> never: the search ends it by an exception."""


def random_search(space: Space, evaluator: Evaluator, seed: int, batch: int | None) -> None:
    """Draw every point uniformly."""
    width = space.numbers + len(space.choices)
    draws, size, begin = Draws(seed, "attack", "random", width=width), batch or 10, 0
    while True:
        evaluator.costs([_point(space, draws[begin + k]) for k in range(size)])
        begin += size


def cma_es(space: Space, evaluator: Evaluator, seed: int, batch: int | None) -> None:
    """Do CMA-ES with margin and categories; it begins again when it no longer improves.

    Raises ImportError without the library.
    """
    again = 0
    while True:
        search = _cma(space, (seed * 1009 + again) % 2**32, batch)
        best, stale = np.inf, 0
        while stale < _STALE and not search.should_stop():
            solutions = [search.ask() for _ in range(search.population_size)]
            costs = evaluator.costs([_of_solution(solution) for solution in solutions])
            # cmaes 0.13 warns of the median of nothing until half of a generation's costs differ:
            # its penalties are then NaN, and the order of the costs stays as it is.
            with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
                search.tell(list(zip(solutions, costs, strict=True)))
            stale = 0 if min(costs) < best else stale + 1
            best = min(best, *costs)
        again += 1
        evaluator.next_target()


def _cma(space: Space, seed: int, batch: int | None) -> Any:
    sizes: dict[str, Any] = {"population_size": batch, "seed": seed}
    if space.numbers:
        mean = np.full(space.numbers, 0.5)
        sizes |= {"x_space": [[0.0, 1.0]] * space.numbers, "mean": mean, "sigma": _SIGMA}
    if space.choices:
        sizes["c_space"] = list(space.choices)
    return CatCMAwM(**sizes)


def _of_solution(solution: Any) -> Point:
    numbers = () if solution.x is None else tuple(solution.x.tolist())
    chosen = () if solution.c is None else tuple(solution.c.argmax(axis=1).tolist())
    return Point(numbers, chosen)


def _point(space: Space, x: Any) -> Point:
    numbers, rest = x[: space.numbers].tolist(), x[space.numbers :].tolist()
    pairs = zip(rest, space.choices, strict=True)
    return Point(tuple(numbers), tuple(min(int(v * count), count - 1) for v, count in pairs))


OPTIMISERS: dict[str, Optimiser] = {"cma-es": cma_es, "random": random_search}
"""By name, the default first."""
