"""A link model fitted to what a link model did is that model."""

import math
import statistics
import tomllib

import pytest

from phalanx.cli.app import status
from phalanx.network.fit import CaptureError, fit, read_capture
from phalanx.network.link import Link
from phalanx.network.table import LinkTable
from phalanx.scenario.load import load
from tests.unit.network.models import model

MODELS = {
    "constant": {"delay": 0.02},
    "uniform": {"delay": {"time": 0.05, "jitter": 0.02, "distribution": "uniform"}},
    "normal": {"delay": {"time": 0.1, "jitter": 0.01, "distribution": "normal"}, "loss": 0.1},
    "pareto": {
        "delay": {"time": 0.1, "jitter": 0.02, "distribution": "pareto", "correlation": 0.5},
        "loss": {"mean": 0.2, "burst": 5.0},
    },
    "paretonormal": {
        "delay": {"time": 0.04, "jitter": 0.005, "distribution": "paretonormal"},
        "loss": {"mean": 0.02, "burst": 3.0},
    },
}


def captured(count: int = 20_000, **fields: object) -> list[str]:
    link = Link(5, "a", "b", model(**fields))
    found = (link.fate(k).delay for k in range(count))
    return ["k,delay", *(f"{k},{'' if d is None else repr(d)}" for k, d in enumerate(found))]


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_what_a_model_did_is_fitted_by_that_model(name):
    model = MODELS[name]
    table = fit(read_capture(captured(**model))).table
    LinkTable.model_validate(table)
    assert set(table) == set(model)
    for field, value in model.items():
        if isinstance(value, dict):
            assert set(table[field]) == set(value)
            for key, part in value.items():
                assert table[field][key] == (
                    part if isinstance(part, str) else pytest.approx(part, rel=0.08)
                )
        else:
            assert table[field] == pytest.approx(value, rel=0.05)


@pytest.mark.slow
def test_the_distance_tells_a_model_that_fits_from_one_that_does_not():
    good = fit(read_capture(captured(**MODELS["normal"])))
    two_ways = ["delay", *(["0.01", "0.5"] * 500)]
    assert good.distance < 0.02
    assert fit(read_capture(two_ways)).distance > 0.2


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["time", "0.1"], "line 1: expected a column delay"),
        (["delay", "0.1", "soon"], "line 3: expected a delay or nothing, got 'soon'"),
        (["delay", "-0.1"], "line 2: expected a delay"),
        (["delay", "inf"], "line 2: expected a delay"),
        (["delay", *["0.1"] * 5], "expected at least 30 messages"),
    ],
)
def test_a_capture_that_is_none_is_refused_with_its_line(lines, message):
    with pytest.raises(CaptureError, match=message):
        read_capture(lines)


def test_what_the_command_prints_is_a_table_of_a_scenario(tmp_path, capsys):
    capture = tmp_path / "capture.csv"
    capture.write_text("\n".join(captured(3000, **MODELS["pareto"])))
    assert status(["fit", "network", str(capture)]) == 0
    table = tomllib.loads(capsys.readouterr().out)
    delay = load("unicycles", {"network": table["network"]}).network.delay
    assert delay.distribution == "pareto"
    assert math.isclose(delay.time, 0.1, rel_tol=0.05)
    assert status(["fit", "network", str(tmp_path / "none.csv")]) == 64


@pytest.fixture
def delays() -> list[float | None]:
    link = Link(5, "a", "b", model(**MODELS["normal"]))
    return [link.fate(k).delay for k in range(3000)]


def in_one_column(delays: list[float | None]) -> str:
    return "\n".join(["delay", *("" if d is None else f"{d}" for d in delays), ""])


def test_an_empty_line_of_one_column_is_a_message_that_was_lost(tmp_path, capsys, delays):
    capture = tmp_path / "capture.csv"
    capture.write_text(in_one_column(delays))
    assert status(["fit", "network", str(capture)]) == 0
    printed = capsys.readouterr().out
    assert f"# 3000 messages, {delays.count(None)} lost" in printed
    assert "loss = " in printed


def test_a_blank_line_among_several_columns_is_none():
    assert len(read_capture([*captured(100), ""])) == 100


def test_delays_in_milliseconds_are_not_taken_for_seconds(tmp_path, capsys, delays):
    capture = tmp_path / "capture.csv"
    capture.write_text(in_one_column([d and 1e3 * d for d in delays]))
    fitting = ["fit", "network", str(capture)]
    assert status(fitting) == 64
    median = 1e3 * statistics.median(d for d in delays if d is not None)
    assert f"half of the delays are above {median:.4g} s" in capsys.readouterr().err
    assert status([*fitting, "--unit", "ms"]) == 0
    printed = capsys.readouterr().out
    assert f"half of the delays are below {median:.4g} ms" in printed
    assert tomllib.loads(printed)["network"]["delay"]["time"] == pytest.approx(0.1, rel=0.05)
    assert status([*fitting, "--unit", "s"]) == 0
