"""One page with the paper's figures, numbered as there, each with what the paper says."""

from collections.abc import Mapping
from pathlib import Path

from phalanx.report.html import figure, quiet, save_page, section, table
from phalanx.report.style import image_of
from phalanx_paper.figures import FIGURES, PaperFigure
from phalanx_paper.runs import RUNS_HEAD, Finished

_ABOUT = (
    "Usevitch and Panagou, Adversarial Resilience for Sampled-Data Systems under "
    "High-Relative-Degree Safety Constraints: its eight figures, from runs of this program. "
    "docs/paper.md says which parameters are the paper's, and where results differ."
)


def claims(runs: Mapping[str, Finished]) -> list[tuple[PaperFigure, str, bool]]:
    """Return what came of the paper's cases, by figure; runs: by their cases' names."""
    return [(f, *f.claim(runs[name])) for f in FIGURES if f.claim for name in f.cases]


def write(path: Path, runs: Mapping[str, Finished]) -> Path:
    """Write the page of all figures; return its path."""
    compared = [
        (f"Figure {paper.number}", paper.says, words, "yes" if holds else "no")
        for paper, words, holds in claims(runs)
    ]
    parts = [
        section("Runs", table(RUNS_HEAD, [one.row() for one in runs.values()])),
        section("Claims", table(("of the paper", "it says", "here", "agrees"), compared)),
        *(_section(paper, runs) for paper in FIGURES),
    ]
    return save_page(path, "The paper's figures", parts, about=_ABOUT)


def _section(paper: PaperFigure, runs: Mapping[str, Finished]) -> str:
    pictures = [
        figure(f"{one.case.title}: {one.case.command()}", image_of(paper.draw(one)))
        for one in (runs[name] for name in (*paper.cases, *paper.more))
    ]
    return section(f"Figure {paper.number}: {paper.title}", "".join([quiet(paper.says), *pictures]))
