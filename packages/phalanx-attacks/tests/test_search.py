"""Searches: found attacks repeat bit for bit, and a search is the same however it was made."""

import itertools
import signal
from concurrent.futures import Executor, Future
from pathlib import Path

import pytest
from phalanx_attacks import optimisers, runner
from phalanx_attacks.archive import Archive, Behaviour, Find, find_of, write_finds
from phalanx_attacks.optimisers import OPTIMISERS
from phalanx_attacks.runner import attack
from phalanx_attacks.search import Options
from phalanx_studies.row import Identity, Row, json_text

import phalanx
from phalanx.launcher import interrupt
from phalanx.scenario.load import scenario_text
from tests.layers import layered

from .weak_swarm import weak


class Direct(Executor):
    """Does each task at once; after so many comes a signal, as from the user."""

    def __init__(self, most: int = 10**6, number=signal.SIGINT) -> None:
        self.done, self._most, self._number = 0, most, number

    def submit(self, fn, /, *args, **named):
        if self.done == self._most:
            signal.raise_signal(self._number)
        self.done += 1
        future: Future = Future()
        future.set_result(fn(*args, **named))
        return future


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "weak.toml"
    path.write_text(scenario_text(weak()))
    return str(path)


def searched(scenario, folder, executor=None, **options):
    executor = executor or Direct()
    return attack(scenario, {}, Options(**options), folder=folder, executor=executor)


def archive(found):
    return [(behaviour, find.number, find.row.trajectory) for behaviour, find, _ in found.finds]


@pytest.mark.slow
@pytest.mark.parametrize(
    "optimiser",
    layered(OPTIMISERS, ("cma-es",)),
)
def test_every_optimiser_finds_an_attack_that_repeats_to_the_same_hash(
    optimiser, scenario, tmp_path
):
    options = {"budget": 15, "optimiser": optimiser, "baseline": False, "fresh": 0}
    attacked = searched(scenario, tmp_path / "out", **options)
    (history,) = attacked.histories
    assert history.violated
    assert len(history.finds) == 15
    for _, find, path in attacked.finds:
        run = phalanx.run(phalanx.load(path), engine="in-process")
        assert run.summary.trajectory == find.row.trajectory
        assert run.verdict == "violated"
        assert find.robustness < 0.0
    assert "Search" in attacked.page.read_text()


class Dying(Executor):
    """Its workers die with each task."""

    def submit(self, fn, /, *args, **named):
        future: Future = Future()
        future.set_exception(RuntimeError("killed"))
        return future


@pytest.mark.slow
def test_runs_that_broke_are_made_again_when_a_search_goes_on(scenario, tmp_path):
    options = {"budget": 3, "baseline": False, "fresh": 0}
    assert not searched(scenario, tmp_path / "out", Dying(), **options).histories[0].finds
    (again,) = searched(scenario, tmp_path / "out", **options).histories
    assert len(again.finds) == 3


class Flat:
    """A space of which all points cost the same, and what an optimiser asked of it."""

    numbers, choices = 2, (3, 2)

    def __init__(self, generations: int) -> None:
        self.points, self.restarts, self._most = [], [], generations

    def costs(self, points):
        self.points.append(points)
        if len(self.points) == self._most:
            raise KeyboardInterrupt
        return [1.0] * len(points)

    def next_target(self):
        self.restarts.append(len(self.points))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("optimiser", OPTIMISERS)
def test_an_optimiser_tries_all_choices_and_begins_again_where_nothing_improves(optimiser):
    """Equal costs raise no warning of CMA-ES either."""
    with pytest.raises(KeyboardInterrupt):
        OPTIMISERS[optimiser](trials := Flat(20), trials, 0, 10)
    points = [point for generation in trials.points for point in generation]
    assert {point.choices for point in points} == set(itertools.product(range(3), range(2)))
    assert all(0.0 <= number <= 1.0 for point in points for number in point.numbers)
    assert len({point.numbers for point in points}) == 200
    assert trials.restarts == ([9, 18] if optimiser == "cma-es" else [])


def test_fresh_seeds_confirm_the_best_of_a_behaviour_and_no_run_that_it_replaced():
    first, best = (
        find_of(
            number,
            Row(
                identity=Identity("", number, "", ""), overrides={}, outcome="safe", reason="",
                robustness=json_text({"1 2": value, "1 3": 9.0}), worst_at=0.5,
            ),
        )
        for number, value in ((1, 0.75), (2, 0.25))
    )  # fmt: skip
    archive = Archive(1.0)
    assert archive.add(first)
    assert archive.add(best)
    archive.confirm(first, [first.row])
    ((_, find),) = archive.best_first
    assert (find.number, find.fresh) == (2, ())
    archive.confirm(best, [best.row])
    assert archive.best_first[0][1].fresh == (best.row,)


def test_of_an_archive_the_violated_runs_become_files_or_else_the_best(tmp_path):
    table = weak()
    finds = [
        Find(
            k,
            Row(identity=Identity("", k, "", ""), overrides={}, outcome=outcome, reason=""),
            float(k),
        )
        for k, outcome in enumerate(("violated", "safe", "violated"))
    ]
    archived = [(Behaviour("1 2", 0, "motion"), find) for find in finds]
    for entries, expected in ((archived, [0, 2]), (archived[1:2], [1]), ([], [])):
        written = [find.number for _, find, _ in write_finds(tmp_path, table, entries)]
        assert written == expected
        assert len(list((tmp_path / "found").glob("*.toml"))) == len(expected)


@pytest.mark.slow
def test_a_search_that_was_stopped_goes_on_where_it_was(scenario, tmp_path):
    complete, options = Direct(), {"budget": 3, "batch": 5, "fresh": 1}
    whole = searched(scenario, tmp_path / "whole", complete, **options)
    with pytest.raises(KeyboardInterrupt):
        searched(scenario, tmp_path / "cut", Direct(most=6), **options)
    assert (tmp_path / "cut" / "attack.html").exists()
    rest = Direct()
    again = searched(scenario, tmp_path / "cut", rest, **options)
    assert archive(again) == archive(whole)
    assert complete.done - 7 <= rest.done < complete.done


@pytest.fixture
def installed():
    """Remember signals as the command does."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    interrupt.install()
    yield
    interrupt.clear()
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.mark.slow
def test_a_signal_in_the_baseline_leaves_the_page(scenario, tmp_path, installed):
    options = {"budget": 2, "batch": 5, "fresh": 0}
    searched(scenario, tmp_path / "whole", whole := Direct(), **options)
    with pytest.raises(KeyboardInterrupt):
        searched(scenario, tmp_path, Direct(whole.done - 1, signal.SIGTERM), **options)
    page = (tmp_path / "attack.html").read_text()
    assert "The best attack" in page


@pytest.mark.slow
def test_a_signal_while_the_page_is_written_leaves_it_whole(
    scenario, tmp_path, installed, monkeypatch
):
    written = runner.write_attack_page
    signals = iter([signal.SIGTERM])

    def interrupted(*given):
        for number in signals:
            signal.raise_signal(number)
        return written(*given)

    monkeypatch.setattr(runner, "write_attack_page", interrupted)
    with pytest.raises(KeyboardInterrupt):
        searched(scenario, tmp_path, budget=5, batch=5, fresh=0, baseline=False)
    assert "The best attack" in (tmp_path / "attack.html").read_text()


@pytest.mark.slow
def test_a_search_makes_no_more_runs_than_its_budget(scenario, tmp_path):
    counts: list[int] = []
    options = Options(budget=2, batch=5, fresh=1, optimiser="random")
    attacked = attack(
        scenario, {}, options, folder=tmp_path, executor=(executor := Direct()),
        progress=lambda history: counts.append(history.begun),
    )  # fmt: skip
    (history,) = attacked.histories
    assert len(history.finds) == 2
    assert executor.done == 2 + history.refused + history.fresh
    ((find, fresh),) = [(find, find.fresh) for _, find, _ in attacked.finds if find.fresh]
    assert [(row.identity.seed, row.searched) for row in fresh] == [(1, False)]
    assert find.row.searched, "and enters no interval"
    assert history.fresh == 1
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] == 2


@pytest.mark.slow
def test_a_search_that_ends_before_it_is_where_it_was_keeps_its_files(
    scenario, tmp_path, monkeypatch
):
    options = {"budget": 3, "batch": 5, "fresh": 0}
    whole = searched(scenario, tmp_path, **options)
    before = {path: path.read_text() for path in (whole.page, *(each[2] for each in whole.finds))}
    assert len(before) > 1
    monkeypatch.setattr(optimisers, "CatCMAwM", None)
    with pytest.raises(TypeError):
        searched(scenario, tmp_path, **options)
    monkeypatch.undo()
    with pytest.raises(KeyboardInterrupt):  # behind the optimiser's rows, before random search
        searched(scenario, tmp_path, Direct(most=0), **{**options, "budget": 12})
    assert {path: path.read_text() for path in before if path.exists()} == before


@pytest.mark.slow
def test_an_inadmissible_start_costs_without_a_run(tmp_path):
    table = weak(starts={"2": [[-1.6, 1.6], [-1.0, -1.0]]}, apart=3.0)
    path = tmp_path / "close.toml"
    path.write_text(scenario_text(table))
    options = {"budget": 2, "optimiser": "random", "batch": 5}
    attacked = searched(str(path), tmp_path / "out", preset="beyond", **options)
    assert '"clock"' in " ".join(map(Path.read_text, (tmp_path / "out").glob("*.toml")))
    (history,) = attacked.histories
    assert history.finds == []
    assert history.refused == 20
    assert attacked.finds == []
