"""Statistics of links, from the steps of the receivers."""

import re
from pathlib import Path

import pytest

from phalanx.recording.read import Recording
from phalanx.report.links import _DOTS, link_statistics
from phalanx.scenario.model import Scenario
from phalanx.theory.rows.origin import Origin
from tests.unit.report.recordings import fate

pytestmark = pytest.mark.nightly


def test_every_control_step_has_a_dot() -> None:
    assert set().union(*(origins for *_, origins in _DOTS)) == set(Origin)


def test_link_statistics_are_those_of_the_links(recording: Recording, faulty: Scenario) -> None:
    statistics = link_statistics(recording)
    assert {(s.sender, s.receiver) for s in statistics} == {
        (a, b) for a in "123" for b in "123" if a != b
    }
    for link in statistics:
        truth = [fate(faulty, link.sender, link.receiver, k) for k in range(40)]
        delays = [delay for delay in truth if delay is not None]
        assert (link.sent, link.decided) == (40, 40)
        assert link.lost == 40 - len(delays) > 0
        assert link.loss == link.lost / 40
        assert link.delays == delays
        assert link.model.loss == 0.3


def test_the_link_table_shows_each_link_next_to_its_model(
    reported: Path, recording: Recording
) -> None:
    html = reported.read_text()
    for link in link_statistics(recording):
        row = next(r for r in html.split("<tr>") if f"{link.sender} → {link.receiver}" in r)
        cells = re.findall(r"<td>(.*?)</td>", row)
        assert cells[:5] == ["40", "40", str(link.lost), f"{100 * link.loss:.2f} %", "30 %"]
        assert cells[6:] == [
            f"{1e3 * min(link.delays):.4g} ms",
            f"{1e3 * max(link.delays):.4g} ms",
            "2 to 20 ms, uniform",
        ]
