"""A trace: each message has the delay or loss of the packet that was measured at its time."""

import pytest

from phalanx.network.link import Link
from phalanx.scenario.load import from_json, load, read_table, scenario_text, shipped
from phalanx.scenario.model import ScenarioError, digest, to_json
from tests.unit.network.models import model

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
