"""A lone unicycle that turns and drives away: no slower chaser ever reaches it."""

from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.guarantee.promise import grades
from phalanx.promise.exit import Chasers
from phalanx.promise.flight import Flight, Flights
from phalanx.promise.reach import Reach
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.wheeled import DynamicUnicycle, Unicycle
from tests.unit.promise.test_runs import scenario, simulate

MODEL, PHI, LONGEST, SHORTEST = Unicycle(speed=4.0, turn_rate=2.0, offset=0.25), 0.3, 0.06, 0.03
FLIGHTS = Flights(MODEL, PHI, LONGEST, SHORTEST)


def nearest(x, u, flight, chaser, push, gaps, fly=FLIGHTS.input) -> float:
    """Least distance of the output point from all that one chaser can reach, over 2 s."""
    place, speed = chaser.places[0], chaser.speeds[0]
    x, t, least = x.copy(), 0.0, np.inf
    while t < 2.0:
        gap = float(gaps())
        for _ in range(6):
            step, angle = gap / 6.0, x[2]
            x += step * (np.array([u[0] * cos(angle), u[0] * sin(angle), u[1]]) + push(x))
            t += step
            y = x[:2] + MODEL.offset * np.array([cos(x[2]), sin(x[2])])
            least = min(least, float(np.linalg.norm(y - place) - speed * t))
        u = fly(x, flight)
    return least


def random_case(rng):
    """A state, an input, a way out, and a chaser: as slow as a wall, or faster, for 2 s."""
    x = np.array([*rng.uniform(-1.0, 1.0, 2), rng.uniform(-pi, pi)])
    u = np.array([rng.uniform(-4.0, 4.0), rng.uniform(-2.0, 2.0)])
    flight = Flight(float(x[2] + rng.choice([0.0, rng.uniform(-pi, pi)])), rng.choice([-1.0, 1.0]))
    angle = rng.uniform(-pi, pi)
    place = x[:2] + rng.uniform(1.0, 8.0) * np.array([cos(angle), sin(angle)])
    speed = rng.choice([0.0, 1.5, 5.0], 1)
    return x, u, flight, Chasers(place[None], np.zeros(1), speed, np.array([2.0]))


def pushes(rng):
    """φ in one direction for all time, on the axle or against the turn."""
    phi = rng.normal(size=3) * rng.choice([1.0, 9.0], 3)
    return lambda _: PHI * phi / np.linalg.norm(phi)


def excess(flights: Flights, seed: int, gaps=None) -> float:
    """Distance by which a chaser comes nearer than was counted [m]."""
    rng = np.random.default_rng(seed)
    x, u, flight, chaser = random_case(rng)
    gaps = gaps or (lambda: rng.uniform(SHORTEST, LONGEST))
    return float(
        flights.gaps(x, u, flight, chaser)[0] - nearest(x, u, flight, chaser, pushes(rng), gaps)
    )


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6))
def test_no_chaser_comes_nearer_to_a_flight_than_was_counted(seed):
    assert excess(FLIGHTS, seed) <= 1e-3


@pytest.mark.parametrize(
    ("part", "mistaken"),
    [
        ("φ", Flights(MODEL, 0.0, LONGEST, SHORTEST)),
        ("τ", Flights(MODEL, PHI, 0.2 * LONGEST, 0.2 * SHORTEST)),
        ("turns", Flights(Unicycle(4.0, 8.0, 0.25), PHI, LONGEST, SHORTEST)),
        ("offset", Flights(Unicycle(4.0, 2.0, 0.0001), PHI, LONGEST, SHORTEST)),
    ],
)
def test_without_one_part_some_chaser_comes_nearer(part, mistaken):
    assert max(excess(mistaken, seed, gaps=lambda: LONGEST) for seed in range(60)) > 0.02


def test_samples_that_come_early_let_a_flight_drift_aside_while_it_turns():
    """It drives on at Ω τ off, and each hold takes off a part of that alone."""
    flights = Flights(Unicycle(4.0, 2.0, 0.01), 0.0, LONGEST, SHORTEST)
    x, u, flight = np.array([0.0, 0.0, 2.0 * LONGEST]), np.zeros(2), Flight(0.0, 1.0)
    wall = Chasers(np.array([[3.0, 1.0]]), *np.zeros((3, 1)))
    gap = flights.gaps(x, u, flight, wall)[0]
    least = nearest(x, u, flight, wall, lambda _: 0.0, lambda: SHORTEST, flights.input)
    assert gap <= least < 1.0 - 0.02


def test_a_flight_turns_first_and_then_drives_on_or_back_and_holds_its_heading():
    x = np.array([0.0, 0.0, 0.5])
    assert FLIGHTS.input(x, Flight(0.5 + 2.0, -1.0)).tolist() == [0.0, 2.0]
    assert FLIGHTS.input(x, Flight(0.5 - 2.0 - 2.0 * pi, 1.0)).tolist() == [0.0, -2.0]
    assert FLIGHTS.input(x, Flight(0.53, -1.0)) == pytest.approx([-4.0, 0.03 / LONGEST])


def test_robots_of_simulation_1_at_a_fifth_of_their_disturbance_need_what_was_worked_out():
    # γ* = 52.6°: R ahead and behind, 1.26 R side-on, and less than a hold's way more.
    flights = Flights(MODEL, 0.2, 0.0121, 0.008)
    x, u = np.array([-0.25, 0.0, 0.0]), np.zeros(2)
    speed = Reach(Unicycle(2.0, 1.0, 0.25), 0.2).for_ever(x)[1]

    def needed(angle: float) -> float:
        def gap(distance: float) -> float:
            place = distance * np.array([[cos(angle), sin(angle)]])
            chaser = Chasers(place, np.zeros(1), np.array([speed]), np.zeros(1))
            return max(flights.gaps(x, u, Flight(0.0, way), chaser)[0] for way in (1.0, -1.0))

        return next(d for d in np.arange(1.0, 3.0, 0.01) if gap(d) >= 1.0)

    assert needed(0.0) < 1.05
    assert needed(pi) < 1.05
    assert 1.26 <= needed(0.5 * pi) < 1.32


HUNTED = {
    "safety__keep": "flight",
    "agents__0__names": ["a"],
    "agents__0__dynamics": {"type": "unicycle", "speed": 4.0, "turn_rate": 2.0},
    "agents__0__start": [[0.0, 0.0, 0.0]],
    "agents__0__goal": [[6.0, 0.0]],
    "agents__1__names": ["c", "d"],
    "agents__1__start": [[3.5, 1.5, 3.0], [3.5, -1.5, 3.0]],
    "obstacles": [{"center": [-6.0, 4.0], "clearance": 0.5}],
    "duration": 4.0,
}
"""One that wants to pass two slower ones, which close in on it."""


@pytest.mark.slow
def test_pursuers_that_catch_a_unicycle_never_do_if_it_keeps_a_flight():
    assert simulate(scenario(**HUNTED | {"safety__keep": None})).violations
    summary = simulate(scenario(**HUNTED))
    assert summary.violations == []
    assert str(summary.promise) == "kept for 3 of 3 pairs (3 for ever, 0 passively)"
    assert summary.origins["fallback"] > 20


def test_one_that_cannot_hold_a_place_may_flee_all_the_same():
    pushed = {f"agents__{g}__disturbance": {"bound": 0.5, "kind": "adverse"} for g in (0, 1)}
    assert grades(build_swarm(scenario(**HUNTED | pushed | {"safety__keep": "hold"}))).refusals
    assert len(grades(build_swarm(scenario(**HUNTED | pushed))).for_ever) == 3


@pytest.mark.slow
def test_what_is_as_fast_as_a_flight_is_outrun_for_a_time():
    fast = {"agents__1__dynamics": {"type": "unicycle", "speed": 4.0, "turn_rate": 1.0}}
    graded = grades(build_swarm(scenario(**HUNTED | fast)))
    assert graded.faster == "c makes 4.01 m/s, a flight 3.94"
    assert graded.for_ever == ("a-obstacle 0",)
    assert 1.0 < graded.until["a-c"] < 4.0
    assert simulate(scenario(**HUNTED | fast)).promise.kept


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"agents__0__names": ["a", "b"], "agents__0__goal": [[6.0, 0.0], [0.0, 6.0]],
          "agents__0__start": [[0.0, 0.0, 0.0], [0.0, 9.0, 0.0]]}, "normal agents: expected one"),
        ({"agents__0__disturbance__bound": 2.5}, "at most 2 would do"),
        ({"agents__0__sensing": 9.0}, "sensing of a: expected none"),
    ],
)  # fmt: skip
def test_what_no_flight_covers_is_refused(changes, why):
    with pytest.raises(ScenarioError, match=why):
        require_runnable(build_swarm(scenario(**HUNTED | changes)))


def test_speeds_of_robots_with_mass_have_no_bound():
    robot = DynamicUnicycle(acceleration=1.0, turn_acceleration=1.0)
    assert Reach(robot, 0.0).for_ever(np.zeros(5)) == (0.0, np.inf)
