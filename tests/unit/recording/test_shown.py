"""A recording whose step data do not fit the scenario is rejected: verify relies on them."""

from pathlib import Path

import msgspec
import pytest

from phalanx.recording.read import Recording, misfit
from phalanx.recording.records import StepData
from phalanx.scenario.load import load

SCENARIO = load("unicycles")
SHOWN = StepData("1", 3, 0.5, ["1", "4"], [0.0] * 6, [("4", 0.4, [1.0, 0.0])])


def recorded(shown: StepData) -> Recording:
    return Recording(Path(), SCENARIO, {}, shown=[shown])


def test_what_fits_is_taken() -> None:
    assert misfit(recorded(SHOWN)) is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"agent": "9"},
        {"agent": "2"},
        {"seen": ["4", "1"]},
        {"seen": ["1", "9"]},
        {"x": [0.0] * 5},
        {"received": [("9", 0.4, [1.0, 0.0])]},
        {"received": [("4", 0.4, [1.0])]},
    ],
    ids=str,
)
def test_what_does_not_is_named(wrong: dict) -> None:
    found = misfit(recorded(msgspec.structs.replace(SHOWN, **wrong)))
    assert found is not None
    assert found.startswith("what agent")
