"""The page of a study shows what the rows say, and nothing that they hold is more than text."""

import base64
import html
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import polars as pl
import pytest
from phalanx_studies.page.write import MOST_LISTED, study_rates, write_study_page

from phalanx.report.style import DARK
from tests.synthetic_studies import frame, study

pytestmark = pytest.mark.slow

AXES = ["network.loss", "safety.information"]
HOSTILE = "<script>alert('&')</script> --> $x_1$ \x07"
ROWS = "<h2>Rows, the worst first</h2>"


def command(row: dict) -> str:
    return f"phalanx run it --seed {row['seed']} --set network.loss={row.get('network.loss')}"


def page(rows: pl.DataFrame, folder: Path, axes=AXES, **more) -> str:
    return write_study_page(rows, axes, "A study", folder / "s.html", command, **more).read_text()


@pytest.fixture(scope="module")
def markup(tmp_path_factory) -> str:
    return page(study(), tmp_path_factory.mktemp("study"))


def drawings(markup: str) -> list[str]:
    found = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', markup)
    return [base64.b64decode(each).decode() for each in found]


def listed(markup: str) -> list[list[str]]:
    """The cells of the table of rows."""
    body = markup.partition(ROWS)[2].partition("<tbody>")[2].partition("</tbody>")[0]
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in body.split("\n") if row]


def test_every_section_is_there(markup):
    assert re.findall("<h2>(.*?)</h2>", markup) == [
        "Outcomes", "Over network.loss", "Over safety.information",
        "network.loss and safety.information", "Worst h",
        "Rows, the worst first",
    ]  # fmt: skip
    assert len(drawings(markup)) == 5
    assert "800 rows; 800 runs with 100 seeds" in markup


def test_the_page_needs_nothing_but_itself(markup):
    sources = re.findall(r"""(?:src|href|url|srcset)\s*[=(]\s*["']?([^"'\s>#]+)""", markup)
    assert len(sources) == 5
    assert all(source.startswith("data:image/svg+xml;base64,") for source in sources)
    inside = [s for each in drawings(markup) for s in re.findall(r'(?:href="|url\()([^")]+)', each)]
    assert inside
    assert all(source.startswith("#") for source in inside)


def test_every_picture_is_described_and_turns_dark_with_the_page(markup):
    assert len(re.findall(r'<img alt="[^"]{30,}" src', markup)) == 5
    for drawing in drawings(markup):
        ET.fromstring(drawing)
        assert "prefers-color-scheme:dark" in drawing
        colours = re.findall(r"(?:fill|stroke): (#\w{6})", drawing)
        assert not set(colours) & set(DARK)
        assert "var(--000000)" in drawing


def test_the_same_rows_give_the_same_file(markup, tmp_path):
    assert page(study(), tmp_path) == markup


def test_the_worst_rows_come_first_each_with_its_command(markup):
    rows, data = listed(markup), study()
    assert len(rows) == MOST_LISTED
    assert f"and {len(data) - MOST_LISTED} more" in markup
    violated = data.filter(pl.col("outcome") == "violated").sort("worst_h", descending=True)
    count = len(violated)
    assert count > 20
    assert [int(row[0]) for row in rows[:count]] == violated["index"].to_list()
    assert [row[-1] for row in rows[:count]] == [
        html.escape(command(row)) for row in violated.iter_rows(named=True)
    ]
    assert [row[4] for row in rows[count:]] == sorted((r[4] for r in rows[count:]), reverse=True)


def test_outcomes_are_listed_by_gravity_and_a_row_without_h_after_those_with_one(tmp_path):
    outcomes = "refused", "guaranteed", "safe", "stopped", "broken", "violated"
    rows = [{"outcome": outcome, "seed": i} for i, outcome in enumerate(outcomes)]
    rows += [{"outcome": "broken", "seed": 7, "worst_h": -3.0}]
    lines = listed(page(frame(rows), tmp_path, []))
    assert [row[0] for row in lines] == ["5", "6", "4", "3", "2", "1", "0"]


def test_searched_rows_are_listed_and_enter_no_interval(tmp_path, markup):
    data = study()
    searched = data.head(30).with_columns(
        index=pl.col("index") + 5000, seed=pl.col("seed") + 5000, outcome=pl.lit("violated"),
        worst_h=pl.lit(9.0), searched=pl.lit(True), input_deviation_mean=pl.lit(-9.0),
    )  # fmt: skip
    both = page(pl.concat([data, searched]), tmp_path)
    start = "<h2>Outcomes</h2>"
    assert (
        both.partition(start)[2].partition(ROWS)[0] == markup.partition(start)[2].partition(ROWS)[0]
    )
    assert {row[0] for row in listed(both)[:30]} == {str(5000 + i) for i in range(30)}
    assert "30 chosen by a search, which are listed and enter no interval" in both
    assert "chosen by a search" not in markup


def test_refused_rows_are_counted_apart(tmp_path):
    rows = [{"outcome": "refused", "seed": i, "reason": "tau: expected less"} for i in range(3)]
    rows += [{"outcome": "violated", "seed": i} for i in range(4)]
    markup = page(frame(rows), tmp_path, [])
    assert "3 refused, since their scenario is not valid" in markup
    assert "100 % [39.8, 100]" in markup
    assert markup.count("tau: expected less") == 3


def test_hostile_text_stays_text(tmp_path):
    rows = [
        {
            "seed": i, "worst_h": 0.1 * i, "outcome": "violated", "reason": HOSTILE,
            "worst_pair": HOSTILE, "faults": HOSTILE, HOSTILE: HOSTILE + str(i % 3),
            "input_deviation_mean": 1.0,
        }
        for i in range(12)
    ]  # fmt: skip
    file = tmp_path / "s.html"
    write_study_page(frame(rows), [HOSTILE], HOSTILE, file, lambda row: HOSTILE)
    markup = file.read_text()
    assert len(re.findall("<script", markup)) == 1
    assert markup.count(html.escape("alert('&')")) > 50
    elements = [e for each in drawings(markup) for e in ET.fromstring(each).iter()]
    assert not any(element.tag.endswith("script") for element in elements)
    texts = [e.text for e in elements if e.tag.endswith("}text")]
    assert any("$x_1$" in text and "-->" in text for text in texts)


def test_an_axis_that_is_drawn_at_random_is_shown_in_ranges(tmp_path):
    rows = [{"gain": i / 7, "seed": i, "worst_h": -1.0 / (i + 1)} for i in range(200)]
    markup = page(frame(rows), tmp_path, ["gain"])
    assert len(re.findall(r'<th scope="row">[\d.]+ to [\d.]+</th><td>25</td>', markup)) == 8


def test_no_rows_no_runs_and_no_axes_have_pages_too(tmp_path):
    some = frame([{"loss": 0.1, "outcome": "refused"}])
    assert "No runs." in page(some, tmp_path, ["loss"])
    assert listed(page(some, tmp_path, []))[0][0] == "0"
    assert "None." in page(some.head(0), tmp_path, ["loss"]).partition(ROWS)[2]


def test_runs_without_numbers_have_a_page_without_those_figures(tmp_path):
    rows = [{"loss": 0.1, "seed": i, "outcome": "broken"} for i in range(3)]
    markup = page(frame(rows), tmp_path, ["loss"])
    assert "Worst h" not in markup
    assert len(drawings(markup)) == 1


def test_an_axis_that_the_frame_lacks_is_named(tmp_path):
    with pytest.raises(
        ValueError, match=r"axes: expected columns of the frame, got 'network\.los'"
    ):
        page(study(1), tmp_path, ["network.los"])
    assert not (tmp_path / "s.html").exists()


def test_a_notebook_shows_the_same_rates(markup):
    short = study_rates(study(), AXES)
    cells = re.findall(r"[\d.]+ % \[[\d., ]+\]", short)
    assert len(cells) == 7 * 3
    assert all(cell in markup for cell in cells)
