"""Shrinking: what is left fails, nothing more can be left out, and it is the same each time."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phalanx_attacks.shrinking import Fields, ddmin, shrink, size_of

needed = st.lists(st.sets(st.integers(0, 19), min_size=1, max_size=4), min_size=1, max_size=3)


def assert_minimal(items, fails) -> list[int]:
    subset = ddmin(items, fails)
    assert fails(subset)
    assert not any(fails([*subset[:k], *subset[k + 1 :]]) for k in range(len(subset)))
    return subset


@given(needed=needed, size=st.integers(20, 30))
def test_no_single_item_of_the_result_can_be_left_out(needed, size):
    """It fails if any of some sets of items is there as a whole."""

    def fails(items: list[int]) -> bool:
        return any(each <= set(items) for each in needed)

    subset = assert_minimal(range(size), fails)
    assert subset == sorted(subset)


@given(odd=st.integers(0, 40))
def test_nor_with_a_predicate_that_is_not_monotone(odd):
    """It fails if the number of items is odd: leaving out one item passes, two fail."""

    def fails(items: list[int]) -> bool:
        return len(items) % 2 == 1 or len(items) > odd

    assert_minimal(range(2 * odd + 1), fails)


def test_few_questions_are_asked_if_one_item_of_many_is_needed():
    asked = []
    assert ddmin(range(1000), lambda items: bool(asked.append(0)) or 777 in items) == [777]
    assert len(asked) < 60


ORIGIN: Fields = {
    "name": "origin",
    "duration": 24.0,
    "safety": {"eta": 3.0},
    "network": {"loss": 0.3, "delay": 0.1},
    "obstacles": [{"clearance": 1.0}, {"clearance": 2.0}],
    "agents": [
        {
            "names": ["1", "2"],
            "role": "normal",
            "law": {"type": "track"},
            "slots": [0, 1],
            "clock": {"period": 0.01, "jitter": 0.002},
        },
        {"names": ["4", "5"], "role": "adversary", "law": {"type": "pursue", "gain": 5.0}},
    ],
}


def attack() -> Fields:
    """The attack of a search: 5 breaks 2 by its second input, from about x = 8.5."""
    agents: list[dict[str, Any]] = [
        {**ORIGIN["agents"][0], "spread": [0.2]},
        {
            "names": ["4", "5"],
            "role": "adversary",
            "law": {"type": "script", "at": [0.0, 0.7, 1.4], "inputs": [[1.0], [2.0], [1.5]]},
            "start": [[1.23456, 2.0], [8.512345, 2.56789]],
        },
    ]
    return {**ORIGIN, "seed": 7, "agents": agents, "safety": {"eta": 2.0}, "faults": [{"at": 0.1}]}


def observe(table: Fields) -> float | None:
    """Fail at 2.03 s if 2 is there, 5 starts near x = 8.5, applies 2, and the run lasts."""
    by_name = {name: (g, k) for g in table["agents"] for k, name in enumerate(g["names"])}
    if "2" not in by_name or "5" not in by_name or table["duration"] < 2.03:
        return None
    group, k = by_name["5"]
    near = abs(group["start"][k][0] - 8.5) < 0.1 if "start" in group else False
    law = group["law"]
    return 2.03 if near and [2.0] in law.get("inputs", ()) else None


def test_what_is_left_of_an_attack_is_what_it_needs():
    small = shrink(attack(), ORIGIN, observe)
    assert small == {
        "name": "origin",
        "duration": 3.0,
        "safety": {"eta": 3.0},
        "agents": [
            {"names": ["2"], "role": "normal", "law": {"type": "track"}, "clock": {"period": 0.01}},
            {
                "names": ["5"],
                "role": "adversary",
                "law": {"type": "script", "at": [0.0], "inputs": [[2.0]]},
                "start": [[8.5, 3.0]],
            },
        ],
        "seed": 0,
    }
    assert size_of(small) < size_of(attack()) / 2


@pytest.mark.parametrize(("off", "rounded"), [(1.0, 8.0), (0.1, 8.5), (0.01, 8.47), (0.001, 8.472)])
def test_a_number_is_rounded_as_far_as_it_still_fails(off, rounded):
    def near(table: Fields) -> float | None:
        starts = [start for group in table["agents"] for start in group.get("start", ())]
        return 1.0 if any(abs(x - 8.47173) < off for (x,) in starts) else None

    table = {**ORIGIN, "agents": [ORIGIN["agents"][0], {**ORIGIN["agents"][1], "names": ["5"]}]}
    table["agents"][1]["start"] = [[8.47173]]
    assert shrink(table, ORIGIN, near)["agents"][-1]["start"] == [[rounded]]


def test_it_is_the_same_again_and_shrinks_no_further():
    small = shrink(attack(), ORIGIN, observe)
    assert shrink(attack(), ORIGIN, observe) == small
    assert shrink(small, ORIGIN, observe) == small
