"""Mistakes in safety: the function, gains, margin and information."""

import pytest

from tests.unit.scenario.broken import Broken, assert_refused, replace, under

BROKEN: list[Broken] = [
    (
        "misspelt field",
        under("[safety]", "roh = 5.0"),
        ["safety.roh: unknown field (misspelt?), got 5.0"],
    ),
    ("no ρ", replace("rho = 5.0", ""), ["safety.rho: expected a value, got nothing"]),
    ("ρ zero", replace("rho = 5.0", "rho = 0"), ["safety.rho: expected greater than 0", "got 0"]),
    (
        "no gain",
        replace("alpha = [2.0]", "alpha = []"),
        ["safety.alpha: ", "expected at least 1 item", "got []"],
    ),
    (
        "negative gain",
        replace("alpha = [2.0]", "alpha = [-2.0]"),
        ["safety.alpha.0: expected greater than 0", "got -2.0"],
    ),
    (
        "η not a number",
        replace("eta = 8.0566", "eta = nan"),
        ["safety.eta: expected ", "got nan"],
    ),
    (
        "η constants incomplete",
        replace("eta = 8.0566", "eta = { c_f = 1.0 }"),
        ["safety.eta.c_g: expected a value, got nothing", "safety.eta.mu: expected a value"],
    ),
    (
        "unknown information model",
        replace('"paper"', '"papper"'),
        ["safety.information: expected 'paper', 'in-flight'", "got 'papper'"],
    ),
    (
        "unknown safe-set function",
        replace('"separation"', '"seperation"'),
        ["safety.function: expected one of separation, ", "package.module:Name", "'seperation'"],
    ),
    (
        "safe-set function without radius",
        replace(", radius = 1.0", ""),
        ["safety.function.radius: expected a value, got nothing"],
    ),
]


@pytest.mark.parametrize(("edit", "fragments"), [b[1:] for b in BROKEN], ids=[b[0] for b in BROKEN])
def test_it_is_refused_with_file_field_expected_and_got(edit, fragments, tmp_path):
    assert_refused(edit, fragments, tmp_path)
