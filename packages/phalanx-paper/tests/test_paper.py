"""phalanx reproduce paper: its eight figures, in one page, with what the paper says of each."""

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from phalanx_paper import runs
from phalanx_paper.figures import FIGURES
from phalanx_paper.page import claims
from phalanx_paper.runs import CASES, Case, Finished, finish

from phalanx.cli.app import status
from phalanx.report.style import ADVERSARY, NORMAL

NUMBERS = list(range(1, 9))


@pytest.fixture(scope="module")
def short(tmp_path_factory) -> dict[str, Finished]:
    """All cases, of half a second."""
    folder = tmp_path_factory.mktemp("paper")
    return dict(finish(folder, {"duration": 0.5}, None, lambda _: None))


def marked(figure: Figure, column: int, marker: str, colour: str) -> list[tuple[float, ...]]:
    """Return the points drawn by a marker of a colour on a column's first panel."""
    lines = [x for x in figure.axes[column].lines if x.get_marker() == marker]
    return [(*x.get_xdata(), *x.get_ydata()) for x in lines if x.get_color() == colour]


@pytest.mark.slow
def test_stills_show_agents_goals_and_the_centre_where_they_were(short):
    run = short["1"].history
    figure = FIGURES[1].draw(short["1"])
    for column, share in enumerate((0.25, 0.5, 0.75)):
        t = share * run.times[-1]
        state = np.flatnonzero(run.times <= t)[-1]
        points = run.positions[state]
        np.testing.assert_array_equal(marked(figure, column, "o", NORMAL), points[:3])
        np.testing.assert_array_equal(marked(figure, column, "o", ADVERSARY), points[3:])
        formation = run.scenario.formation
        goals = [formation.goal(slot, t).position for slot in (0, 1, 4, 2, 3)]
        np.testing.assert_array_equal(marked(figure, column, "x", "black"), goals)
        assert formation.center(t).position == pytest.approx(
            marked(figure, column, "D", "#d10fd1")[0]
        )


@pytest.mark.slow
def test_stills_in_space_have_a_row_from_one_side(short):
    figure = FIGURES[5].draw(short["2"])
    assert [axes.get_ylabel() for axes in figure.axes] == ["y [m]"] * 3 + ["z [m]"] * 3


@pytest.mark.slow
def test_what_the_paper_says_is_compared_with_each_of_its_runs(short):
    compared = [(figure.number, holds) for figure, _, holds in claims(short)]
    assert [number for number, _ in compared] == [1, 1, 3, 4, 5, 7, 8]
    came = dict(compared)
    assert came[3]
    assert came[7]
    assert not came[4], "in half a second the margin is not missed"


def pictures(page: Path) -> dict[int, int]:
    """Return the number of pictures by figure of the paper."""
    sections = re.split(r"<h2>Figure (\d+): ", page.read_text("utf-8"))[1:]
    numbers, texts = sections[::2], sections[1::2]
    counts = [text.count("data:image/png") for text in texts]
    return dict(zip(map(int, numbers), counts, strict=True))


@pytest.mark.slow
def test_one_command_makes_a_page_of_all_figures_and_names_what_differs(tmp_path, capsys):
    words = ["--out", str(tmp_path), "--set", "duration=0.5"]
    assert status(["reproduce", "paper", *words]) == 1
    assert pictures(tmp_path / "paper.html") == dict.fromkeys(NUMBERS, 1) | {1: 2, 7: 3}
    printed = capsys.readouterr().out
    assert re.search(r"figure 4: largest h_tot -\S+: not as the paper says", printed)
    assert re.search(r"figure 3: largest h_tot -\S+$", printed, re.MULTILINE)
    text = (tmp_path / "paper.html").read_text("utf-8")
    assert all(case.command() in text for case in CASES.values())


def test_a_cases_own_fields_come_before_those_of_every_case(monkeypatch, tmp_path):
    monkeypatch.setattr(runs, "CASES", {"a": Case("A", "one-on-one", {"duration": 0.01})})
    ((_, run),) = finish(tmp_path, {"duration": 0.02}, None, lambda _: None)
    assert run.summary.t == 0.01


def test_another_paper_is_refused(capsys):
    assert status(["reproduce", "thesis"]) == 64
    assert "paper" in capsys.readouterr().err


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_all_figures_come_out_as_the_paper_says(tmp_path, capsys):
    assert status(["reproduce", "paper", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "not as" not in printed
    assert re.findall(r"^figure (\d)", printed, re.MULTILINE) == list("1134578")
    page = (tmp_path / "paper.html").read_text("utf-8")
    for title, verdict in (
        ("Simulation 1", "guaranteed"),
        ("Simulation 2", "guaranteed"),
        ("Simulation 1, η = 0", "violated"),
        ("Simulation 2, η = ξ = 0", "violated"),
        ("Simulation 2, β = 3 as printed", "guaranteed"),
    ):
        row = page.partition(f'<th scope="row">{title}</th>')[2].partition("</tr>")[0]
        assert f"<td>{verdict}</td>" in row
