"""Scenarios and recordings that are not quite right: read, or refused in words, and soon."""

import random
from pathlib import Path

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from phalanx.guarantee.verdict import CertificateSummary, certified
from phalanx.scenario.load import ScenarioError, load
from tests.hostile.files import TRIALS
from tests.hostile.messages import SUMMARY

SECONDS = 5.0


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
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


@pytest.mark.parametrize("field", ["delay", "loss", "duplicate", "preset"])
@pytest.mark.parametrize("value", ["2026-11-22", "[0.1]", "[]"])
def test_a_value_of_no_kind_that_a_field_knows_is_refused(field: str, value: str):
    with pytest.raises(ScenarioError, match=rf"network\.{field}"):
        load("unicycles", [f"network.{field}={value}"])


@pytest.mark.parametrize(
    "place",
    ["formation.path=[[0.0, inf], [0.0, 0.0]]", "formation.finish=inf", "formation.radius=nan"],
)
def test_a_formation_at_no_place_is_refused(place: str):
    with pytest.raises(ScenarioError, match="finite number"):
        load("unicycles", [place])


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        (CertificateSummary(samples=3), "no input was applied"),
        (CertificateSummary(3, 3, 1.0, "1-2", None), "3 of 3 inputs"),
    ],
)
def test_figures_that_do_not_belong_together_are_still_told(figures: CertificateSummary, said: str):
    assert said in certified(msgspec.structs.replace(SUMMARY, certificates=figures))
