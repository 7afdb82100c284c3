"""Reports on more than 12 agents: the worst few by name over envelopes of all."""

import re

import msgspec
import numpy as np
import pytest
from matplotlib.axes import Axes

from phalanx.recording.curves.history import ReportHistory
from phalanx.recording.read import Recording, read, size_in_words
from phalanx.report.links import link_statistics, losses
from phalanx.report.safety import nearest
from phalanx.report.write import notes, write_report
from tests.unit.report.recordings import drift, record, summary_of, swarm_in_space

pytestmark = pytest.mark.nightly

WORST_RECEIVER = "n11"


@pytest.fixture(scope="module")
def crowded(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """16 normal agents and 3 adversaries; n11's received inputs are a second older than others'."""
    extra = {"network": {"loss": 0.3}, "obstacles": [{"center": [5.0, 2.0, 1.0], "clearance": 1.0}]}
    scenario = swarm_in_space(16, 3, extra)
    records = [
        msgspec.structs.replace(r, ages=[(l, age + 1.0) for l, age in r.ages], oldest_input=None)
        if getattr(r, "agent", "") == WORST_RECEIVER
        else r
        for r in drift(scenario, states=20, steps=10)
    ]
    folder = tmp_path_factory.mktemp("crowd")
    return read(record(folder, scenario, records, summary_of(scenario)))


@pytest.fixture(scope="module")
def history(crowded: Recording) -> ReportHistory:
    return ReportHistory(crowded)


def named(axes: Axes) -> list[str]:
    return [str(text.get_text()) for text in axes.get_legend().get_texts()]


def test_nearest_and_closest_are_those_of_all_distances(history: ReportHistory) -> None:
    swarm = history.swarm
    pairs = [p for p in swarm.safe_set.pairs if p.b in set(swarm.normal)]
    closest = nearest(history, pairs, swarm.normal, 3)
    p = history.positions[:, list(swarm.normal)]
    between = np.linalg.norm(p[:, :, None] - p[:, None], axis=-1) + 1e9 * np.eye(16)
    np.testing.assert_allclose(closest.distances, between.min(axis=2), rtol=1e-12)
    least = np.sort(between[:, *np.triu_indices(16, 1)].min(axis=0))
    assert [distance for _, distance in closest.closest] == pytest.approx(least[:3])


def test_the_worst_pair_is_the_one_with_the_largest_h(history: ReportHistory) -> None:
    distance = np.array([history.distance(p) for p in history.swarm.safe_set.pairs])
    np.testing.assert_allclose(history.h, 1.0 - distance.min(axis=0) ** 2, rtol=1e-9)
    assert history.h[history.worst] == history.h.max()
    nearest = int(distance[:, history.worst].argmin())
    assert history.worst_pair == history.swarm.safe_set.pairs[nearest]


def test_losses_name_the_links_that_lost_more_than_their_model(crowded: Recording) -> None:
    links = link_statistics(crowded)
    (axes,) = losses(crowded, links).axes
    worst = max(links, key=lambda link: link.excess)
    assert len(links) == 16 * 15
    assert named(axes)[0] == "240 links"
    assert f"{worst.sender} → {worst.receiver}: {worst.lost} of 10" in named(axes)
    assert worst.lost == max(link.lost for link in links)


@pytest.mark.filterwarnings("error")
def test_the_report_is_short_and_says_what_it_leaves_out(
    crowded: Recording, history: ReportHistory
) -> None:
    report = write_report(crowded.path)
    names = {image.stem for image in (report.parent / "figures").iterdir()}
    few = {"inputs-n0", "inputs-n1", "inputs-n2", "inputs-n3"}
    assert names == few | {
        "h_tot", "paths", "distances", "inputs", "certified", "ages", "solve-times", "losses",
        "space-time",
    }  # fmt: skip
    html = report.read_text()
    assert "and 180 more" in html
    assert len(re.findall("→", html.split("<h2>Figures")[0])) == 60
    assert size_in_words(crowded) in html
    (note,) = notes(history)
    assert note.startswith("More than 12 agents")
