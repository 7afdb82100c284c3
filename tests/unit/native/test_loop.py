"""The loop in C gives what the same run in process does, to the bit: verdict, recording, hash."""

import shutil
from collections.abc import Iterator
from unittest.mock import ANY

import pytest

import phalanx
from phalanx.native import library
from phalanx.native.library import COMPILER, FOLDER
from phalanx.native.loop import engine
from phalanx.native.loop.eligible import reason_against
from phalanx.scenario.load import shipped
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from tests.hostile.drawn_runs import compare, differences, in_c, in_process
from tests.hostile.drawn_scenarios import FAMILY
from tests.hostile.native_pieces import different, pieces

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler"),
]
TYPICAL = [
    "unicycles", "formation3d", "guaranteed", "stale-inputs", "attacks/two-pursuers",
    "faults/burst", "faults/corrupt", "faults/delay", "faults/distance", "faults/duplicate",
    "faults/loss", "faults/rate", "faults/reorder", "faults/slot", "faults/trace",
]  # fmt: skip
OTHERS = [
    "formation3d-beta3", "formation3d-distance", "one-on-one", "pinned", "surrounded", "crossing",
    "fence", "heading-aware", "swarm", "swarm2d", "quadrotors", "warehouse", "attacks/one-pursuer",
    "attacks/paper-margin", "attacks/paper-margin-two", "attacks/turned-away",
]  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A cache of functions that are compiled fast: no option but -ffp-contract changes a bit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(COMPILER, "cc")
        patch.setenv(FOLDER, str(tmp_path_factory.mktemp("cache") / "functions"))
        patch.setattr(library, "_OPTIONS", ("-O0", *library._OPTIONS[1:]))
        _forget()
        yield
    _forget()


def _forget() -> None:
    library._folder.cache_clear()
    library._compiler.cache_clear()
    library._loaded.clear()


@pytest.mark.parametrize("name", TYPICAL)
def test_verdict_and_recording_are_those_of_the_run_in_process(name):
    assert_same(phalanx.load(name, {"duration": 0.6}))


@pytest.mark.parametrize("name", ["faults/reorder", "faults/loss"])
def test_the_newest_input_counts_until_its_sender_is_silent_or_far(name):
    """Older ones overtake it, and many are lost; those far away weigh nothing in the row."""
    paper = {"safety.information": "paper", "safety.silence": 0.06, "safety.rho": 900.0}
    assert_same(phalanx.load(name, {**paper, "safety.neighbourhood": 2.2, "duration": 0.6}))


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("name", TYPICAL + OTHERS)
def test_so_are_those_of_all_other_shipped_scenarios_and_seeds(name, seed):
    assert_same(phalanx.load(name, {"duration": 1.0}, seed))


# Of the first family, agents begin outside the safe set; of the second, margins are unknown.
@pytest.mark.parametrize(
    "family", [543, 504, *(pytest.param(f, marks=pytest.mark.nightly) for f in range(20))]
)
def test_so_are_those_of_scenarios_drawn_at_random(family):
    """`python -m tests.hostile.drawn_runs 10000` makes many more."""
    assert next(compare([FAMILY * family])) == ("equal", ANY)


def test_each_piece_alone_gives_what_its_reference_in_python_does():
    """`python -m tests.hostile.native_pieces 100000` compares more."""
    assert list(different(pieces(("-O0",)), (256, 400, 60, 120))) == []


def assert_same(scenario: Scenario) -> None:
    assert list(differences(in_c(scenario), in_process(scenario))) == []


def test_all_others_have_a_reason_in_words():
    reasons = {
        name: reason_against(build_rows(build_swarm(phalanx.load(name))))
        for name in shipped()
        if not name.startswith("worlds")
    }
    assert {name for name, reason in reasons.items() if reason is None} == {*TYPICAL, *OTHERS}
    assert reasons["guaranteed-radio"] == "agents know one another by radio"


@pytest.mark.parametrize(
    ("overrides", "why"),
    [
        ({"safety.information": "unknown", "safety.eta": 1.0}, "its information model"),
        ({"reseed": [{"at": 0.01, "seed": 2}]}, "its seed changes"),
        ({"network.sample.loss": 0.5}, "links on board 1 have rules"),
        ({"safety.watch": True}, "agents prove, watch or keep a fallback"),
    ],
)
def test_what_is_not_eligible_runs_in_process_and_the_log_says_why(overrides, why, caplog):
    scenario = phalanx.load("unicycles", {"duration": 0.05, **overrides})
    run = phalanx.run(scenario, engine="native")
    assert why in caplog.text
    assert run.summary.trajectory == phalanx.run(scenario, engine="in-process").summary.trajectory


def test_without_a_compiler_too(monkeypatch, caplog):
    monkeypatch.setattr(library, "_compiler", lambda: None)
    run = phalanx.run(phalanx.load("unicycles", {"duration": 0.05}), engine="native")
    assert "no C compiler" in caplog.text
    assert run.summary.steps > 0


def test_a_run_that_the_loop_cannot_finish_is_made_in_process(monkeypatch, caplog):
    monkeypatch.setattr(engine.CompiledRun, "advance", _failing)
    run = phalanx.run(phalanx.load("one-on-one", {"duration": 0.05}), engine="native")
    assert "too many broadcasts" in caplog.text
    assert run.summary.steps > 0


def _failing(_: object) -> int:
    raise engine.LoopError("too many broadcasts are under way at once")
