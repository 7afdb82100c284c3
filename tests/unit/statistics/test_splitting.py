"""Rare events by splitting: unbiased, with intervals that cover, by far fewer runs."""

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from phalanx.seeded.draws import Draws
from phalanx.statistics.rates import clopper_pearson
from phalanx.statistics.splitting import Splitting, combined, split

DRIFT, BEGIN = -0.5, 1.0
LEVEL = 9.4
"""Exceeded by one path in about 10 000."""
NORMAL = NormalDist()


@dataclass(frozen=True)
class Walk:
    """A walk by normal steps of mean DRIFT, until it is below 0; its score is where it is."""

    x: tuple[float, ...]

    @classmethod
    def begin(cls, seed: int) -> "Walk":
        return cls((BEGIN,)).going_on(seed)

    @property
    def peak(self) -> float:
        return max(self.x)

    def branch(self, level: float, seed: int) -> "Walk":
        first = next(k for k, x in enumerate(self.x) if x > level)
        return Walk(self.x[: first + 1]).going_on(seed)

    def going_on(self, seed: int) -> "Walk":
        draws, x = Draws(seed, "walk"), list(self.x)
        while x[-1] >= 0.0:
            x.append(x[-1] + DRIFT + NORMAL.inv_cdf(draws.value(len(x)) or 0.5))
        return Walk(tuple(x))


def truth(level: float) -> float:
    """Return the probability that the walk exceeds a level.

    It is u(BEGIN) of u(x) = P(x' > level) + ∫ p(x' = y) u(y) dy over [0, level], by quadrature.
    """
    nodes, weights = np.polynomial.legendre.leggauss(400)
    y, w = level * (nodes + 1.0) / 2.0, weights * level / 2.0

    def steps_to(x: np.ndarray) -> np.ndarray:
        apart = y - DRIFT - x[:, None]
        return w * np.exp(-0.5 * apart**2) / math.sqrt(2.0 * math.pi)

    u = np.linalg.solve(np.eye(len(y)) - steps_to(y), ndtr(y + DRIFT - level))
    return float(ndtr(BEGIN + DRIFT - level) + (steps_to(np.array([BEGIN])) @ u)[0])


def estimates(count: int, level: float = LEVEL, **options: int) -> list[Splitting]:
    return [split(Walk.begin, level, seed=seed, **options) for seed in range(count)]


def test_the_event_is_as_rare_as_it_should_be():
    assert truth(LEVEL) == pytest.approx(1e-4, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [{"paths": 20}, pytest.param({"paths": 40, "stopped": 10}, marks=pytest.mark.nightly)],
)
def test_estimates_are_unbiased_also_with_few_paths(options):
    found = np.array([each.probability for each in estimates(150, **options)])
    assert found.mean() == pytest.approx(truth(LEVEL), abs=3.5 * found.std() / math.sqrt(150))
    assert found.std() / math.sqrt(150) < 0.15 * truth(LEVEL), "or the test could not fail"


def counted(paths: int) -> int:
    """Return how many of some independent paths exceed LEVEL."""
    draws, hits, x, k = Draws(0, "plain", width=1000), 0, np.full(paths, BEGIN), 0
    while len(x):
        noise = ndtri(np.concatenate([draws[k + n] for n in range(-(-len(x) // 1000))]))
        x, k = x + DRIFT + noise[: len(x)], k + -(-len(x) // 1000)
        hits += int((x > LEVEL).sum())
        x = x[(x >= 0.0) & (x <= LEVEL)]
    return hits


@pytest.mark.nightly
@pytest.mark.slow
def test_it_finds_what_counting_finds_by_twenty_times_fewer_runs():
    found, plain = combined(estimates(40)), 200_000
    hits = counted(plain)
    exact = clopper_pearson(hits, plain)
    assert exact.low < found.probability < exact.high
    assert found.interval.low < truth(LEVEL) < found.interval.high
    assert found.plain_runs > 20 * found.runs


@pytest.mark.nightly
@pytest.mark.slow
def test_its_interval_covers_and_the_least_error_is_no_larger():
    level = 4.0
    known, rounds, each = truth(level), 60, 10
    singles = estimates(rounds * each, level, paths=20)
    groups = [combined(singles[n : n + each]) for n in range(0, len(singles), each)]
    missed = sum(not group.interval.low <= known <= group.interval.high for group in groups)
    assert missed <= 9, "of 60, 3 are expected, and more than 9 in one study of 900"
    relative = np.std([single.probability for single in singles]) / known
    ideal = math.sqrt(-math.log(known) / 20)
    assert 0.8 * ideal < relative < 3.0 * ideal
    assert np.median([s.least_error for s in singles]) == pytest.approx(ideal, rel=0.3)


def test_what_no_path_reaches_has_the_interval_of_the_independent_paths():
    @dataclass(frozen=True)
    class Flat:
        peak: float = 0.0

        def branch(self, level: float, seed: int) -> "Flat":
            raise AssertionError("no path is ahead of the others")

    found = [split(lambda seed: Flat(), 1.0, paths=50, seed=seed) for seed in (0, 1)]
    assert [each.probability for each in found] == [0.0, 0.0]
    assert combined(found).interval == clopper_pearson(0, 100)


def test_what_all_paths_reach_is_certain():
    sure = split(Walk.begin, -1.0, paths=10)
    assert (sure.probability, sure.runs) == (1.0, 10)
    assert sure.least_error == 0.0


def test_the_same_seed_gives_the_same_however_paths_are_computed():
    def backwards(function, items):
        return [function(item) for item in list(items)[::-1]][::-1]

    one, other = (
        split(Walk.begin, 4.0, paths=30, stopped=8, seed=5, executes=executes)
        for executes in (map, backwards)
    )
    assert one == other
    assert one != split(Walk.begin, 4.0, paths=30, stopped=8, seed=6)


def test_all_paths_cannot_be_stopped_at_once():
    with pytest.raises(ValueError, match=r"stopped: expected 1 to 9, got 10"):
        split(Walk.begin, 1.0, paths=10, stopped=10)
