"""The page shows the verdict and its evidence, whatever texts it holds, and needs no other file."""

import html
import re
import shlex
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

import phalanx
from phalanx.cli.app import FAILED, status
from phalanx.recording.read import read
from phalanx.recording.records import RECORDING, Step
from phalanx.recording.write import RecordingWriter
from phalanx.report.html import table
from phalanx.report.safety import _required, worst
from phalanx.report.write import REPORT, write_report
from phalanx.scenario.load import load
from phalanx.scenario.model import digest
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.exact import LARGEST_SUM
from tests.unit.report.recordings import drift, record, summary_of, unicycles

pytestmark = pytest.mark.slow

PNG = b"\x89PNG\r\n\x1a\n"


def test_the_report_shows_the_verdict_and_its_evidence(reported: Path) -> None:
    page = reported.read_text()
    assert "<strong>violated</strong>" in page
    for text in ("24 of 120", "0.25 at t = 0.300 s", "ab" * 32, "20.00 %", "0.050 s"):
        assert text in page


def test_the_contents_lead_to_every_section(reported: Path) -> None:
    page = reported.read_text()
    contents = re.findall(r'<a href="#(.*?)">(.*?)</a>', page)
    assert [title for _, title in contents] == re.findall("<h2>(.*?)</h2>", page)
    names = [name for name, _ in contents]
    assert names == re.findall(r'<section id="([\w-]+)">', page)
    assert len(set(names)) > 6
    assert page.index("<img") < page.index("<nav>") < page.index("<h2>")


def test_an_obstacle_asks_for_another_distance_than_agents_do() -> None:
    scenario = load("one-on-one", {"obstacles": [{"center": [9.0, 0.0], "clearance": 2.0}]})
    assert _required(build_swarm(scenario).safe_set.pairs, scenario) == {1.0, 2.0}


def test_the_report_needs_nothing_but_itself(reported: Path) -> None:
    page = reported.read_text()
    sources = re.findall(r"""(?:src|href|url|srcset)\s*[=(]\s*["']?([^"'\s>#]+)""", page)
    images = {image.name: image.read_bytes() for image in (reported.parent / "figures").iterdir()}
    assert {"h_tot.png", "paths.png", "distances.png", "certified.png", "ages.png"} < set(images)
    assert all(image.startswith(PNG) for image in images.values())
    assert len(sources) == len(images) == 11
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "//" not in re.sub(r"base64,[^\"]+", "", page)


def test_a_table_says_how_many_rows_it_leaves_out_of_those_that_there_are():
    rows = [(str(k), "x") for k in range(3)]
    for total, most, omitted in ((None, 3, 0), (None, 2, 1), (7, 2, 5), (7, 4, 4)):
        written = table(("k", ""), rows, total, most)
        assert written.count('<tr><th scope="row">') == min(3, most)
        assert re.findall(r"and (\d+) more", written) == ([str(omitted)] if omitted else [])


def test_hostile_text_stays_text(reported: Path) -> None:
    page = reported.read_text()
    assert "<script" not in page
    escaped = "&lt;script&gt;alert(&#x27;&amp;&#x27;)&lt;/script&gt;"
    # Description, reason, rejected payload, event, and the scenario at the end.
    assert page.count(escaped) == 5


def test_a_recording_cut_short_is_reported_with_its_damage(tmp_path: Path) -> None:
    scenario = unicycles()
    folder = record(tmp_path, scenario, drift(scenario, states=700), summary_of(scenario))
    file = folder / RECORDING
    file.write_bytes(file.read_bytes()[: int(0.75 * file.stat().st_size)])
    cut = read(folder)
    assert cut.summary is None
    assert 0 < len(cut.states) + len(cut.steps) < 900
    page = write_report(folder).read_text()
    assert "<strong>unfinished</strong>" in page
    assert cut.damage is not None
    assert cut.damage in page
    peak = worst(cut)
    assert peak is not None
    assert peak.h == max(cut.h)


@pytest.mark.nightly
def test_the_largest_numbers_that_agents_may_report_are_drawn(tmp_path: Path) -> None:
    scenario = unicycles()
    records = [
        msgspec.structs.replace(
            r, residual=LARGEST_SUM, margin=-LARGEST_SUM, solve_time=LARGEST_SUM,
            u_nom=(LARGEST_SUM,) * len(r.u), ages=[(name, LARGEST_SUM) for name, _ in r.ages],
        )
        if isinstance(r, Step) and r.k % 3 == 0 else r
        for r in drift(scenario)
    ]  # fmt: skip
    folder = record(tmp_path, scenario, records, summary_of(scenario))
    assert "<strong>violated</strong>" in write_report(folder).read_text()


def test_a_recording_without_a_state_says_so(tmp_path: Path) -> None:
    page = write_report(record(tmp_path, unicycles(), [], None)).read_text()
    assert "The recording holds no state: there is nothing to draw." in page
    assert "<img" not in page


def test_the_heading_has_the_command_that_makes_it_again_the_date_and_versions(
    reported: Path,
) -> None:
    heading = reported.read_text().split("<h2>")[0]
    network = "network.delay={ low = 0.002, high = 0.02 }"
    fields = f"--set duration=0.6 --set network.loss=0.3 --set '{network}'"
    command = re.search("<pre>(.*)</pre>", heading)
    assert html.unescape(command[1]) == f"phalanx run unicycles --seed 0 {fields}"
    assert re.search(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d", heading)
    for library in ("phalanx", "eclipse-zenoh", "casadi", "python"):
        assert f"{library} {read(reported.parent).metadata[library]}" in heading


def test_the_command_of_the_heading_makes_the_same_scenario(reported: Path) -> None:
    scenario = read(reported.parent).scenario
    _, _, source, *options = shlex.split(scenario.reading.command(scenario.seed))
    fields = [after for flag, after in pairwise(options) if flag == "--set"]
    again = load(source, fields, scenario.seed)
    assert digest(again) == digest(scenario.model_copy(update={"description": again.description}))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A folder with a recording of two states, next to a folder with a file."""
    scenario = load("one-on-one", ["duration=0.1"])
    for name in ("run", "elsewhere"):
        (tmp_path / name).mkdir()
    (tmp_path / "elsewhere" / "file").write_text("precious")
    records = drift(scenario, states=2, steps=0)
    return record(tmp_path / "run", scenario, records, summary_of(scenario))


def test_a_link_in_the_place_of_a_report_or_a_figure_is_replaced(run: Path):
    target = run.parent / "elsewhere" / "file"
    (run / "figures").mkdir()
    links = run / REPORT, run / "figures" / "h_tot.png"
    for link in links:
        link.symlink_to(target)
    assert phalanx.open(run).report() == run / REPORT
    assert target.read_text() == "precious"
    assert not any(link.is_symlink() for link in links)
    assert "</html>" in (run / REPORT).read_text()


def test_a_link_in_the_place_of_the_folder_of_figures_is_refused(run: Path, capsys):
    (run / "figures").symlink_to(run.parent / "elsewhere")
    assert status(["report", str(run)]) == FAILED
    assert f"{run / 'figures'}: expected a folder, found a link" in capsys.readouterr().err
    assert [file.name for file in (run.parent / "elsewhere").iterdir()] == ["file"]
    assert [file.name for file in run.iterdir() if not file.is_symlink()] == [RECORDING]


def test_a_recording_in_no_order_of_time_is_reported_up_to_there(tmp_path: Path, capsys):
    whole = phalanx.run(load("unicycles", ["duration=0.1"]), engine="in-process").recording
    with RecordingWriter(tmp_path / RECORDING, whole.scenario, "run-1") as writer:
        writer.write(*whole.states[::-1], *whole.steps)
        writer.finish(whole.summary)
    assert status(["report", str(tmp_path)]) == 0
    line, *_ = capsys.readouterr().err.splitlines()
    assert "damaged after t = 0.100 s: a record of t = 0.09" in line
