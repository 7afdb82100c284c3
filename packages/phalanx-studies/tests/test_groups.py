"""Runs are grouped by an axis' values in an order that a reader expects."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phalanx_studies.page.figures import one_of_each_seed, short
from phalanx_studies.page.groups import MOST_GROUPS, by_axis, group, labels
from phalanx_studies.row import counted
from phalanx_studies.statistics import betting, clopper_pearson

from tests.synthetic_studies import frame


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ([0.3, 0.1, 0.3, 2.0], ["0.1", "0.3", "2"]),
        ([10, 9, 10], ["9", "10"]),
        (["split", "paper", "split"], ["split", "paper"]),
        ([True, False], ["true", "false"]),
        ([0.5, None], ["not set", "0.5"]),
        ([None, None], ["not set"]),
        ([], []),
    ],
)
def test_values_are_named_numbers_in_ascending_order_and_texts_as_they_come(values, names):
    group_names, of_row = labels(pl.Series("axis", values))
    assert group_names == names
    assert [group_names[i] for i in of_row] == [
        "not set" if v is None else str(v).lower() if isinstance(v, bool | str) else f"{v:g}"
        for v in values
    ]


@pytest.mark.slow
@given(st.lists(st.floats(-1e3, 1e3) | st.none(), min_size=60, max_size=200))
def test_many_numbers_are_in_ranges_that_hold_them(values):
    names, of_row = labels(pl.Series("axis", values, dtype=pl.Float64))
    if len(set(values)) <= MOST_GROUPS:
        return
    assert len(names) <= MOST_GROUPS
    for value, i in zip(values, of_row, strict=True):
        if value is None:
            assert names[i] == "not set"
        else:
            low, high = map(float, names[i].split(" to "))
            room = 0.01 * max(abs(low), abs(high)) + 1e-9
            assert low - room <= value <= high + room


def test_of_many_texts_the_rarer_ones_are_one_group():
    values = [f"attack-{i}" for i in range(20) for _ in range(40 - i)]
    found, of_row = labels(pl.Series("axis", values))
    assert found == [*(f"attack-{i}" for i in range(MOST_GROUPS - 1)), "others"]
    assert (of_row == MOST_GROUPS - 1).sum() == sum(40 - i for i in range(MOST_GROUPS - 1, 20))


def test_a_rate_counts_runs_of_their_own_seeds_and_seeds_that_are_common():
    alone = frame([{"seed": i, "outcome": "violated" if i < 3 else "safe"} for i in range(9)])
    assert group("", alone).rates["violated"] == (1 / 3, clopper_pearson(3, 9), 9)
    both = pl.concat([alone, alone.with_columns(outcome=pl.lit("safe"))])
    rate = group("", both).rates["violated"]
    assert rate == (pytest.approx(1 / 6), betting([0.5] * 3 + [0.0] * 6), 18)


def test_neither_searched_nor_refused_rows_are_counted():
    rows = [{"outcome": o, "searched": s} for o in ("violated", "refused") for s in (True, False)]
    assert counted(frame(rows))["index"].to_list() == [1]


def test_groups_hold_all_runs_of_their_value():
    runs = frame([{"loss": 0.1 * (i % 3), "seed": i} for i in range(30)])
    groups = by_axis(runs, "loss")
    assert [each.label for each in groups] == ["0", "0.1", "0.2"]
    assert [each.rows["index"].to_list() for each in groups] == [
        list(range(start, 30, 3)) for start in range(3)
    ]


def test_a_distribution_has_one_run_of_each_seed_whatever_the_order():
    runs = frame([{"seed": i % 10, "worst_h": float(i)} for i in range(50)])
    values = one_of_each_seed(runs)
    assert sorted(int(v) % 10 for v in values) == list(range(10))
    assert len({int(v) // 10 for v in values}) > 2
    assert set(one_of_each_seed(runs.reverse()).tolist()) != set()
    single = frame([{"seed": 4, "worst_h": float(i)} for i in range(5)])
    assert list(one_of_each_seed(single)) == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert len(one_of_each_seed(frame([{}]))) == 0


def test_a_label_is_short_and_has_no_controls():
    assert short("a\x00b\nc") == "a b c"
    assert short("x" * 22) == "x" * 22
    assert short("x" * 23) == "x" * 21 + "…"
    assert np.all([len(short("y" * n)) <= 22 for n in range(50)])
