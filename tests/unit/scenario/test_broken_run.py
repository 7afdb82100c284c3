"""Mistakes in the run itself: its name, duration, seed and time."""

import pytest

from tests.unit.scenario.broken import Broken, assert_refused, replace, under

BROKEN: list[Broken] = [
    ("no name", replace('name = "unicycles"', ""), ["name: expected a value, got nothing"]),
    (
        "name unfit for a key",
        replace('"unicycles"', '"uni/cycles"'),
        ["name: expected 1 to 32 of a-z 0-9", "got 'uni/cycles'"],
    ),
    (
        "negative duration",
        replace("duration = 24.0", "duration = -1.0"),
        ["duration: expected greater than 0", "got -1.0"],
    ),
    (
        "duration in words",
        replace("duration = 24.0", 'duration = "long"'),
        ["duration: expected a valid number", "got 'long'"],
    ),
    (
        "infinite duration",
        replace("duration = 24.0", "duration = inf"),
        ["duration: expected a finite number", "got inf"],
    ),
    (
        "true for a number",
        replace("duration = 24.0", "duration = true"),
        ["duration: expected a valid number", "got True"],
    ),
    (
        "negative seed",
        replace("duration = 24.0", "duration = 24.0\nseed = -3"),
        ["seed: expected greater than or equal to 0", "got -3"],
    ),
    (
        "misspelt table",
        replace("[formation]", "[formatoin]"),
        ["formatoin: unknown field (misspelt?)"],
    ),
    (
        "a latency as long as the shortest sampling gap",
        under("duration = 24.0", "time = { latency = 0.008 }"),
        ["time.latency: expected less than 0.008 s", "got 0.008"],
    ),
    (
        "Runge-Kutta step too long",
        replace("[formation]", "[time]\nintegration_step = 0.01\n\n[formation]"),
        ["time.integration_step: expected less than or equal to 0.001", "got 0.01"],
    ),
    ("no agents", lambda t: t[: t.index("[[agents]]")], ["agents: expected a value, got nothing"]),
    (
        "several errors at once",
        lambda t: (
            t.replace("rho = 5.0", "rho = -5.0")
            .replace("duration = 24.0", "")
            .replace("period = 0.01", 'period = "fast"')
        ),
        [
            "duration: expected a value, got nothing",
            "safety.rho: expected greater than 0, got -5.0",
            "agents.0.clock.period: expected a valid number, got 'fast'",
            "agents.1.clock.period: expected a valid number, got 'fast'",
        ],
    ),
]


@pytest.mark.parametrize(("edit", "fragments"), [b[1:] for b in BROKEN], ids=[b[0] for b in BROKEN])
def test_it_is_refused_with_file_field_expected_and_got(edit, fragments, tmp_path):
    assert_refused(edit, fragments, tmp_path)
