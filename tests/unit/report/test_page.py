"""The page shows the verdict and its evidence, whatever texts it holds, and needs no other file."""

import re
from pathlib import Path

from phalanx.recording.read import read
from phalanx.recording.records import RECORDING
from phalanx.report.measures import (
    worst,
)
from phalanx.report.write import write_report
from tests.unit.report.recordings import (
    drift,
    record,
    summary_of,
    unicycles,
)

PNG = b"\x89PNG\r\n\x1a\n"


def test_the_report_shows_the_verdict_and_its_evidence(reported: Path) -> None:
    html = reported.read_text()
    assert "<strong>violated</strong>" in html
    for text in ("24 of 120", "0.25 at t = 0.300 s", "ab" * 32, "20.00 %", "0.050 s"):
        assert text in html


def test_the_report_needs_nothing_but_itself(reported: Path) -> None:
    html = reported.read_text()
    sources = re.findall(r"""(?:src|href|url|srcset)\s*[=(]\s*["']?([^"'\s>]+)""", html)
    assert len(sources) == len(list((reported.parent / "figures").iterdir())) == 11
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "//" not in re.sub(r"base64,[^\"]+", "", html)


def test_hostile_text_stays_text(reported: Path) -> None:
    html = reported.read_text()
    assert "<script" not in html
    escaped = "&lt;script&gt;alert(&#x27;&amp;&#x27;)&lt;/script&gt;"
    # Description, reason, rejected payload, event, and the scenario at the end.
    assert html.count(escaped) == 5


def test_every_figure_is_a_png(reported: Path) -> None:
    images = sorted((reported.parent / "figures").iterdir())
    assert {"h_tot.png", "paths.png", "distances.png", "certified.png", "ages.png"} <= {
        i.name for i in images
    }
    assert all(image.read_bytes().startswith(PNG) for image in images)


def test_a_recording_cut_short_is_reported_with_its_damage(tmp_path: Path) -> None:
    scenario = unicycles()
    folder = record(tmp_path, scenario, drift(scenario, states=700), summary_of(scenario))
    file = folder / RECORDING
    file.write_bytes(file.read_bytes()[: int(0.75 * file.stat().st_size)])
    cut = read(folder)
    assert cut.summary is None
    assert 0 < len(cut.states) + len(cut.steps) < 900
    html = write_report(folder).read_text()
    assert "<strong>unfinished</strong>" in html
    assert cut.damage is not None
    assert cut.damage in html
    peak = worst(cut)
    assert peak is not None
    assert peak.h_tot == max(cut.h_tot)


def test_a_recording_without_a_state_says_so(tmp_path: Path) -> None:
    html = write_report(record(tmp_path, unicycles(), [], None)).read_text()
    assert "The recording holds no state: there is nothing to draw." in html
    assert "<img" not in html
