"""Scenarios and recordings that are not quite right: read, or refused in words, and soon."""

import random
from pathlib import Path

import pytest
from fuzz_files import TRIALS
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from phalanx.scenario.load import ScenarioError, load

SECONDS = 5.0


@pytest.mark.parametrize("what", TRIALS)
@given(seed=st.integers(0, 2**32))
@settings(
    max_examples=60,
    deadline=1000.0 * SECONDS,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_what_is_spoilt_ends_in_words(what: str, tmp_path: Path, seed: int):
    outcome = TRIALS[what](random.Random(seed), tmp_path)
    assert outcome in {"accepted", "read", "cut short", "refused", "no table"}


@pytest.mark.parametrize("value", ["2026-11-22", "[0.1]", "[]"])
def test_a_delay_that_is_neither_a_number_nor_a_table_is_refused(value: str):
    with pytest.raises(ScenarioError, match=r"network\.delay"):
        load("unicycles", [f"network.delay={value}"])
