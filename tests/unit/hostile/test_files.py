"""Scenarios and recordings that are not quite right: read, or refused in words, and soon."""

import random
from pathlib import Path

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from phalanx.guarantee.check import check
from phalanx.guarantee.verdict import CertificateSummary, certified
from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from tests.hostile.files import TRIALS
from tests.hostile.messages import SUMMARY

SECONDS = 5.0


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("what", ["scenarios", "recordings"])
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


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("part", [0, *(pytest.param(n, marks=pytest.mark.nightly) for n in (1, 2))])
@given(seed=st.integers(0, 2**32))
@settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_what_is_spoilt_is_checked_or_refused_in_words(part: int, tmp_path: Path, seed: int):
    outcome = TRIALS["checks"](random.Random(f"{part} {seed}"), tmp_path)
    assert outcome in {"accepted", "refused"}


CARS = {
    **{f"agents.{n}.dynamics": {"type": "unicycle", "speed": 1, "turn_rate": 2} for n in (0, 1)},
    "agents.0.start": [[0.0, 0.0, 0.0]],
    "agents.1.start": [[0.0, -1.7, 0.5]],
}
AHEAD = {"type": "heading-aware", "radius": 1.0, "kappa": 1e69}
UNKNOWN = {"safety.information": "unknown", "agents.0.goal": [[1.0, 1.0]]}
HUGE = {
    "gain": {**UNKNOWN, "agents.0.law.gain": 1e160},
    "speed": {"agents.0.dynamics.speed": 7e275},
    "κ": {**CARS, "safety.function": AHEAD},
}


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("what", HUGE)
def test_a_check_of_a_huge_number_prints_and_warns_of_nothing(what: str, capfd):
    assert check(load("one-on-one", HUGE[what])).answer
    assert capfd.readouterr() == ("", "")


@pytest.mark.filterwarnings("error")
def test_a_box_too_large_for_float64_is_refused_without_a_warning():
    with pytest.raises(ScenarioError, match="flows: no room for"):
        load("swarm2d", {"flows.room": 1.7e308})


NO_ROW = {
    "agents.0.start": [[1e150, 0.0]],
    "agents.1.dynamics.speed": 7e275,
    "safety.alpha": [1e300],
}


@pytest.mark.slow
def test_a_row_that_is_not_a_number_at_the_start_is_refused():
    with pytest.raises(ScenarioError, match="one-on-one: at the start the row is not a number"):
        check(load("one-on-one", {**UNKNOWN, **NO_ROW}))


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
def test_figures_that_do_not_belong_together_are_still_printed(
    figures: CertificateSummary, said: str
):
    assert said in certified(msgspec.structs.replace(SUMMARY, certificates=figures))
