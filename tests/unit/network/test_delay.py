"""Delays over 40 000 messages against the distributions of their names, and traces of packets."""

from functools import cache

import numpy as np
import pytest
from scipy.stats import ks_1samp, norm, rankdata, spearmanr

from phalanx.network.delay import LONGEST
from phalanx.network.link import Link
from phalanx.scenario.load import from_json, load, read_table, scenario_text, shipped
from phalanx.scenario.model import ScenarioError, digest, to_json
from tests.unit.network.models import MANY, SOME, delays, model

TIME, JITTER = 0.1, 0.02


def uniform(s):
    return np.clip((s + 1.0) / 2.0, 0.0, 1.0)


def pareto(s):
    """Distribution function of netem's scaled Pareto: x = 3/2 + 3/4 s >= 1 has the tail x^-3."""
    return np.where(s >= LONGEST, 1.0, 1.0 - np.maximum(1.0, 1.5 + 0.75 * s) ** -3.0)


@cache
def paretonormal_quantiles():
    """On a fine grid: a quarter normal and three quarters Pareto of one draw."""
    u = np.linspace(1e-7, 1.0 - 1e-7, 200_001)
    x = np.minimum(((1.0 - u) ** (-1.0 / 3.0) - 1.5) * 4.0 / 3.0, LONGEST)
    return 0.25 * norm.ppf(u) + 0.75 * x, u


def paretonormal(s):
    return np.interp(s, *paretonormal_quantiles())


EXPECTED = {"uniform": uniform, "normal": norm.cdf, "pareto": pareto, "paretonormal": paretonormal}


@pytest.mark.slow
@pytest.mark.parametrize("distribution", EXPECTED)
def test_a_delay_has_the_distribution_that_it_is_named_after(distribution):
    sample = delays(delay={"time": TIME, "jitter": JITTER, "distribution": distribution})
    scaled = (sample - TIME) / JITTER
    expected = EXPECTED[distribution]
    # Of Pareto's one in ninety is at the end of netem's table, where the distribution jumps.
    inside = scaled < LONGEST - 1e-9
    share = float(expected(np.array(LONGEST - 1e-9)))
    assert np.mean(inside) == pytest.approx(share, abs=4.0 * np.sqrt(0.02 / MANY))
    assert ks_1samp(scaled[inside], lambda s: expected(s) / share).pvalue > 0.01
    others = [cdf for name, cdf in EXPECTED.items() if name != distribution]
    assert all(ks_1samp(scaled, cdf).pvalue < 1e-6 for cdf in others)


def test_a_delay_between_two_times_fills_them_evenly_and_no_message_knows_of_another():
    drawn = delays(delay={"low": 0.01, "high": 0.03})
    assert ks_1samp(drawn, lambda t: np.clip((t - 0.01) / 0.02, 0.0, 1.0)).pvalue > 0.01
    assert abs(spearmanr(drawn[1:], drawn[:-1]).statistic) < 4.0 / np.sqrt(MANY)


@pytest.mark.slow
@pytest.mark.parametrize(("distribution", "correlation"), [("normal", 0.9), ("paretonormal", 0.25)])
def test_a_correlation_is_met_and_leaves_the_distribution_as_it_is(distribution, correlation):
    table = {"time": TIME, "jitter": JITTER, "distribution": distribution}
    sample = delays(delay={**table, "correlation": correlation})
    # Runs of equal draws: of so many messages (1 - correlation) are draws of their own.
    effective = MANY * (1.0 - correlation) / (1.0 + correlation)
    ranks = rankdata(sample)
    for ahead in (1, 2, 5):
        correlation_of_ranks = np.corrcoef(ranks[ahead:], ranks[:-ahead])[0, 1]  # Spearman's
        assert correlation_of_ranks == pytest.approx(
            correlation**ahead, abs=5.0 / np.sqrt(effective)
        )
    scaled = (sample - TIME) / JITTER
    distance = ks_1samp(scaled, EXPECTED[distribution]).statistic
    assert distance < 1.63 / np.sqrt(effective)


def test_no_delay_is_below_zero():
    drawn = delays(SOME, delay={"time": 0.01, "jitter": 0.02, "distribution": "normal"})
    assert drawn.min() == 0.0
    assert np.mean(drawn == 0.0) == pytest.approx(norm.cdf(-0.5), abs=0.01)


def test_a_floor_grows_with_the_distance():
    floor = {"time": 0.001, "per_metre": 0.002}
    link = Link(0, "a", "b", model(delay_floor=floor, delay={"low": 0.0, "high": 0.02}))
    bare = Link(0, "a", "b", model(delay={"low": 0.0, "high": 0.02}))
    for metres in (0.0, 1.0, 5.0):
        least = 0.001 + 0.002 * metres
        for k in range(200):
            bare_delay = bare.fate(k).delay
            delay = link.fate(k, distance=metres).delay
            assert delay == pytest.approx(max(bare_delay, least), abs=1e-15)


def test_every_gap_th_message_is_reordered():
    every_fifth = delays(50, delay=0.01, reorder={"gap": 5})
    assert np.flatnonzero(every_fifth == 0.0).tolist() == list(range(4, 50, 5))


PACKETS = {"t": [0.0, 0.1, 0.3], "delay": [0.01, -1.0, 0.02]}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a scenario that names trace.csv; the current one is another."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "a.toml").write_text(shipped()["faults/trace"].read_text("utf-8"))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "mine"


def test_a_message_has_the_fate_of_the_packet_at_its_time_and_the_trace_begins_again():
    link = Link(0, "a", "b", model(trace=PACKETS))
    times = [0.0, 0.09, 0.1, 0.29, 0.3, 0.44, 0.451, 0.56, 45.1]
    fates = [link.fate(k, t).delay for k, t in enumerate(times)]
    assert fates == [0.01, 0.01, None, None, 0.02, 0.02, 0.01, None, None]


def test_a_scenario_holds_the_packets_of_a_file_in_its_own_folder(folder):
    (folder / "trace.csv").write_text("k,t,delay\n0,100.0,0.01\n1,100.1,\n2,100.3,0.02\n")
    scenario = load(folder / "a.toml")
    assert scenario.network.trace == load("faults/trace", {"network.trace": PACKETS}).network.trace
    assert from_json(to_json(scenario)) == scenario
    written = folder / "written.toml"
    written.write_text(scenario_text(read_table(folder / "a.toml")))
    (folder / "trace.csv").write_text("t,delay\n0,0.01\n1,0.02\n")
    assert digest(load(written)) == digest(scenario) != digest(load(folder / "a.toml"))


def test_links_and_faults_have_traces_of_their_own_relative_to_the_current_folder(folder):
    (folder.parent / "b.csv").write_text("t,delay\n0,0.5\n1,\n")
    fault = {"kind": "link", "for": 1.0, "trace": "b.csv"}
    changed = {"network.links": [{"from": "1", "trace": "b.csv"}], "faults": [fault]}
    links = load("faults/trace", changed).links()
    assert links.declared == ("network.trace", "network.links.0.trace", "faults.0 (link)")
    found = [Link(0, of, "3", links.model(of, "3")).fate(0, 0.25).delay for of in ("1", "2")]
    assert found == pytest.approx([0.5 + 0.5, 0.5 + 0.0064])


MISTAKES = {
    "t,delay\n0,0.1\n0.1,fast\n": "line 3, delay: expected seconds or nothing, got 'fast'",
    "t,delay\n0,0.1\n,0.1\n": "line 3, t: expected seconds, got ''",
    "t,delay\n1,0.1\n0.5,0.1\n": "line 3, t: expected more than 1.0, got 0.5",
    "t,delay\n0,-0.1\n1,0\n": "line 2, delay: expected seconds or nothing, got '-0.1'",
    "time,delay\n0,0.1\n": "line 1: expected columns t and delay, got ['time', 'delay']",
    "t,delay\n0,0.1\n": "trace.csv: expected 2 to 2000 packets, got 1",
    "": "line 1: expected columns t and delay, got None",
    None: "trace.csv: expected a CSV file, got none",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_in_the_file_is_named_with_line_and_column(folder, text):
    if text is not None:
        (folder / "trace.csv").write_text(text)
    with pytest.raises(ScenarioError) as error:
        load(folder / "a.toml")
    assert MISTAKES[text] in str(error.value)
    assert str(error.value).startswith(f"{folder / 'a.toml'}: trace ")
