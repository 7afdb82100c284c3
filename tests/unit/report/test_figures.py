"""The report says what the recording holds, and needs nothing but itself."""

import re
from collections.abc import Mapping
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from phalanx.guarantee.verdict import Assumption, Outcome, Summary, Violation
from phalanx.network.link import Link
from phalanx.recording.read import Recording, read
from phalanx.recording.records import RECORDING, Log, State, Step
from phalanx.recording.write import RecordingWriter
from phalanx.report import figures, space
from phalanx.report.measures import (
    Motion,
    extremes_kept,
    link_statistics,
    origins,
    steps_by_agent,
    worst,
)
from phalanx.report.write import notes, plates, write_report
from phalanx.scenario.load import load, validate
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.origin import Origin

PNG = b"\x89PNG\r\n\x1a\n"
HOSTILE = "<script>alert('&')</script>"


def drift(scenario: Scenario, states: int = 60, steps: int = 40) -> list[State | Step | Log]:
    """Records of a swarm that drifts along x; inputs and links as real as their rules make them."""
    swarm = build_swarm(scenario)
    composed = swarm.chain.set
    h_tot = ca.Function("h", [composed.x], [composed.substitute(composed.h_tot)])
    along = np.concatenate([np.eye(len(m.dynamics.states))[0] for m in swarm.members])
    records: list[State | Step | Log] = []
    for t in np.linspace(0.0, scenario.duration, states):
        x = swarm.start() + t * along
        records.append(State(float(t), x.tolist(), float(h_tot(x))))
    for k in range(steps):
        records += [step(scenario, swarm.names, i, k) for i in range(len(swarm.members))]
    return records


def step(scenario: Scenario, names: tuple[str, ...], i: int, k: int) -> Step:
    """Step k: normal agents' K_i is empty in every fifth, without authority in every tenth."""
    group = {name: group for name, group, _ in scenario.roster()}
    t, normal = 0.01 * k, group[names[i]].role == "normal"
    others = [n for n in names if normal and n != names[i] and group[n].role == "normal"]
    origin = Origin.QP if k % 5 else Origin.NO_AUTHORITY if k % 10 else Origin.BACKUP
    fates = []
    for sender in others:
        delay = fate(scenario, sender, names[i], k)
        fates.append((sender, k, -1.0 if delay is None else delay))
    return Step(
        names[i],
        k,
        t,
        t,
        [0.1] * len(group[names[i]].dynamics_object().inputs),
        origin if normal else Origin.ATTACK,
        0.0,
        1e-4 * (1 + k % 7),
        [0.002 * (k % 4) if k and name in others else None for name in names],
        fates,
    )


def fate(scenario: Scenario, sender: str, receiver: str, k: int) -> float | None:
    return Link(scenario.seed, sender, receiver, scenario.network.link(sender, receiver)).fate(k)


def summary_of(scenario: Scenario, reason: str = "h <= 0 throughout") -> Summary:
    return Summary(
        outcome=Outcome.VIOLATED,
        reason=reason,
        t=scenario.duration,
        seed=scenario.seed,
        trajectory="ab" * 32,
        worst_h_tot=0.25,
        worst_at=0.3,
        worst_pair="1-4",
        steps=200,
        origins={"qp": 96, "backup": 12, "no-authority": 12},
        assumptions=[Assumption("non-empty K_i", 24, 120, 0.05, "a row had a solution")],
        violations=[Violation("1-4", 0.2, 0.25, 0.3, 0.15)],
        rejected={f"stale {HOSTILE}": 7},
        wall_time=0.5,
    )


def record(
    folder: Path, scenario: Scenario, records: list[State | Step | Log], summary: Summary | None
) -> Path:
    with RecordingWriter(folder / RECORDING, scenario, "test-1") as writer:
        for each in records:
            writer.write(each)
        if summary:
            writer.finish(summary)
    return folder


def unicycles(*overrides: str) -> Scenario:
    return load("unicycles", ["duration=0.6", *overrides])


def swarm_in_space(normal: int, adversaries: int, extra: Mapping[str, object]) -> Scenario:
    """Single integrators, three-dimensional, on a line."""
    groups = []
    for role, count, y in (("normal", normal, 0.0), ("adversary", adversaries, 9.0)):
        if count:
            groups.append(
                {
                    "names": [f"{role[0]}{i}" for i in range(count)],
                    "role": role,
                    "dynamics": {"type": "single-integrator", "speed": 1.0, "dimension": 3},
                    "law": {"type": "pursue", "gain": 1.0}
                    if role == "adversary"
                    else {"type": "track-velocity", "gain": 1.0},
                    "clock": {"period": 0.01},
                    "start": [[3.0 * i, y, 0.5 * i] for i in range(count)],
                }
            )
    safety = {
        "function": {"type": "separation", "radius": 1.0},
        "rho": 5.0,
        "alpha": [2.0],
        "eta": 1.0,
    }
    return validate(
        {"name": "space", "duration": 0.6, "safety": safety, "agents": groups, **extra}, "test"
    )


@pytest.fixture(scope="module")
def faulty() -> Scenario:
    return unicycles("network.loss=0.3", "network.delay={low=0.002, high=0.02}")


@pytest.fixture(scope="module")
def reported(faulty: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a whole recording whose every text is hostile."""
    scenario = faulty.model_copy(update={"description": HOSTILE})
    records = [*drift(scenario), Log(0.1, HOSTILE)]
    folder = record(
        tmp_path_factory.mktemp("run"), scenario, records, summary_of(scenario, HOSTILE)
    )
    return write_report(folder)


@pytest.fixture(scope="module")
def recording(reported: Path) -> Recording:
    return read(reported.parent)


def test_link_statistics_are_those_of_the_links(recording: Recording, faulty: Scenario) -> None:
    found = link_statistics(recording)
    assert {(s.sender, s.receiver) for s in found} == {
        (a, b) for a in "123" for b in "123" if a != b
    }
    for link in found:
        truth = [fate(faulty, link.sender, link.receiver, k) for k in range(40)]
        kept = [delay for delay in truth if delay is not None]
        assert (link.sent, link.decided) == (40, 40)
        assert link.lost == 40 - len(kept) > 0
        assert link.loss == link.lost / 40
        assert link.delays == kept
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


def test_a_mark_stands_at_every_step_with_an_empty_set(recording: Recording) -> None:
    swarm = build_swarm(recording.scenario)
    for axes in figures.inputs(recording, swarm, 0).axes:
        marks = {c.get_label(): c.get_offsets()[:, 0] for c in axes.collections}
        assert list(marks["backup (4 steps)"]) == pytest.approx([0.0, 0.1, 0.2, 0.3])
        assert list(marks["no-authority (4 steps)"]) == pytest.approx([0.05, 0.15, 0.25, 0.35])
    assert origins(recording) == {"qp": 96, "backup": 12, "no-authority": 12}


def test_inputs_are_drawn_between_the_bounds_of_their_polytope(recording: Recording) -> None:
    speed, turn_rate = figures.inputs(recording, build_swarm(recording.scenario), 4).axes
    for axes, bound in ((speed, 2.0), (turn_rate, 1.0)):
        dotted = [line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == ":"]
        assert sorted(dotted) == pytest.approx([-bound, bound])


def test_where_the_inputs_lie_in_a_cube_their_infinity_norm_is_drawn_first() -> None:
    u = np.array([[0.5, -1.5, 1.0], [0.0, 0.2, -0.1]])
    norm, *components = figures.input_curves(build_swarm(load("formation3d")), 0, u)
    assert norm.label == "‖u‖∞ [SI]"
    assert list(norm.values) == [1.5, 0.2]
    assert norm.bounds == (2.0,)
    assert len(components) == 3
    assert len(figures.input_curves(build_swarm(load("unicycles")), 0, u[:, :2])) == 2


def test_the_report_shows_the_verdict_and_its_evidence(reported: Path) -> None:
    html = reported.read_text()
    assert "<strong>violated</strong>" in html
    for text in ("24 of 120", "0.25 at t = 0.300 s", "ab" * 32, "20.00 %", "0.050 s"):
        assert text in html


def test_the_report_needs_nothing_but_itself(reported: Path) -> None:
    html = reported.read_text()
    sources = re.findall(r"""(?:src|href|url|srcset)\s*[=(]\s*["']?([^"'\s>]+)""", html)
    assert len(sources) == len(list((reported.parent / "figures").iterdir())) == 9
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
    assert {"h_tot.png", "paths.png", "distances.png", "ages.png"} <= {i.name for i in images}
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


def test_one_normal_agent_alone_with_an_obstacle_in_space(tmp_path: Path) -> None:
    obstacles = [{"center": [5.0, 2.0, 1.0], "clearance": 1.0}]
    scenario = swarm_in_space(1, 0, {"obstacles": obstacles})
    report = write_report(record(tmp_path, scenario, drift(scenario), summary_of(scenario)))
    names = {image.stem for image in (report.parent / "figures").iterdir()}
    assert names == {"h_tot", "paths", "distances", "inputs-n0", "solve-times"}


@pytest.mark.filterwarnings("error")
def test_many_agents_in_space_keep_the_legends_short(tmp_path: Path) -> None:
    scenario = swarm_in_space(16, 3, {})
    records = drift(scenario, states=20, steps=6)
    recording = read(record(tmp_path, scenario, records, summary_of(scenario)))
    (note,) = notes(recording)
    assert note.startswith("Inputs are drawn for 12 of 16 normal agents")
    assert sum(p.name.startswith("inputs-") for p in plates(recording, [])) == 12
    swarm = build_swarm(scenario)
    motion = Motion(recording, swarm)
    above, side = space.paths(recording, motion).axes
    assert (above.get_ylabel(), side.get_ylabel()) == ("y [m]", "z [m]")
    for axes in space.distances(recording, swarm, motion).axes:
        assert len(axes.get_legend().get_texts()) == 12
    received = figures.ages(recording)
    assert received is not None
    assert len(received.axes) == 12
    received.draw_without_rendering()  # warns if the legends leave the panels no room


def test_distances_are_those_of_the_output_points(recording: Recording) -> None:
    swarm = build_swarm(recording.scenario)
    motion = Motion(recording, swarm)
    composed = swarm.chain.set
    h = ca.Function("h", [composed.x], [composed.h])
    for state in (0, 59):
        between = np.array(h(recording.x[state]))[:, 0]
        for pair, expected in zip(composed.pairs, between, strict=True):
            radius = 1.0 if pair.obstacle is None else 1.25
            found = radius**2 - motion.distance(pair)[state] ** 2
            assert found == pytest.approx(expected, rel=1e-9)


def test_fewer_points_keep_every_peak() -> None:
    y = np.sin(np.linspace(0.0, 30.0, 100_001))
    y[[777, 50_000]] = 9.0, -9.0
    y[20_000:40_000] = np.nan
    kept = extremes_kept(y, 400)
    assert len(kept) <= 402
    assert {0, 777, 50_000, 100_000} <= set(kept.tolist())
    assert np.isnan(y[kept]).any()
    assert list(extremes_kept(y[:300], 400)) == list(range(300))


def test_steps_are_sorted_by_agent(recording: Recording) -> None:
    found = steps_by_agent(recording)
    assert list(found) == ["1", "2", "3", "4", "5"]
    assert [s.k for s in found["3"]] == list(range(40))
