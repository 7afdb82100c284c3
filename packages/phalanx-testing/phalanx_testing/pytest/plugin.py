"""The plugin that pytest loads: options, the mark, fixtures, and hooks on a failure.

Every session of pytest imports this, also one without a swarm: whatever takes long is imported
where it is used.
"""

import itertools
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

if TYPE_CHECKING:
    from phalanx_testing import CheckedRun, LiveRun, RateStudy

MARK = (
    "phalanx(seeds=1, vary={}): run the test with each seed (their number, or a list) and each "
    "combination of values of the fields of a scenario, by path"
)
_FIXTURES = {"phalanx_run", "phalanx_live"}
_RUNS = pytest.StashKey[list["CheckedRun | LiveRun"]]()
"""The runs of a test."""
_PROPERTIES = {
    "seed": "seed", "verdict": "outcome", "worst_h": "worst_h", "trajectory": "trajectory"
}  # fmt: skip
"""Properties in junit's file, with the fields of a summary."""


class Case(NamedTuple):
    """One run of a test that the mark repeats."""

    seed: int | None = None
    """None: the scenario's."""
    fields: tuple[tuple[str, Any], ...] = ()
    """Varied fields by path."""

    def conditions(self, given: dict[str, Any]) -> dict[str, Any]:
        """Return the conditions that a test gave, with those of the case that it did not give."""
        fields = dict(self.fields)
        faults = [*given.get("faults", ()), *fields.pop("faults", ())]
        seed = {} if self.seed is None else {"seed": self.seed}
        overrides = {**fields, **(given.get("overrides") or {})}
        return {**seed, **given, "faults": faults, "overrides": overrides}

    def __str__(self) -> str:
        """Return an id that -k takes."""
        fields = [("seed", self.seed), *self.fields]
        return "-".join(f"{path}:{value}" for path, value in fields)


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("phalanx", "swarms under network faults")
    group.addoption(
        "--phalanx-engine", metavar="NAME", help="engine of phalanx_run; default: the fastest"
    )
    group.addoption(
        "--phalanx-shrink", action="store_true", help="shrink the scenario of a violated run"
    )
    group.addoption(
        "--phalanx-artifacts",
        metavar="DIR",
        type=Path,
        help="copy runs of failed tests there, with their reports",
    )
    group.addoption(
        "--phalanx-scenario", metavar="FILE", type=Path, help="run it in place of tests' scenarios"
    )
    parser.addini(
        "phalanx_scenarios", "folder of regressions: failures are kept and repeated", type="paths"
    )


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", MARK)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Make a test of each seed and each combination of values of the mark."""
    mark = metafunc.definition.get_closest_marker("phalanx")
    if mark is None:
        return
    if not _FIXTURES & set(metafunc.fixturenames):
        fixtures = " or ".join(sorted(_FIXTURES))
        raise pytest.UsageError(f"{metafunc.definition.nodeid}: mark phalanx needs {fixtures}")
    cases = list(_cases(*mark.args, **mark.kwargs))
    metafunc.parametrize("phalanx_case", cases, ids=map(str, cases), indirect=True)


def _cases(seeds: Any = 1, vary: dict[str, list[Any]] | None = None) -> Iterator[Case]:
    vary = vary or {}
    for seed in range(seeds) if isinstance(seeds, int) else seeds:
        for values in itertools.product(*vary.values()):
            yield Case(seed, tuple(zip(vary, values, strict=True)))


@pytest.fixture
def phalanx_case(request: pytest.FixtureRequest) -> Case:
    """Return seed and fields that the mark gives this test."""
    case: Case = getattr(request, "param", Case())
    return case


@pytest.fixture
def phalanx_run(
    request: pytest.FixtureRequest, phalanx_case: Case, tmp_path: Path
) -> Callable[..., "CheckedRun"]:
    """Return a function that runs a scenario under faults: `phalanx_testing.run`."""

    def run(scenario: Any, *, engine: str | None = None, **conditions: Any) -> "CheckedRun":
        from phalanx_testing import run

        chosen = engine or request.config.option.phalanx_engine
        engines = {"engine": chosen} if chosen else {}
        source, under = _conditions(request, phalanx_case, tmp_path, scenario, conditions)
        finished = run(source, **under, **engines)
        request.node.stash.setdefault(_RUNS, []).append(finished)
        return finished

    return run


@pytest.fixture
def phalanx_live(
    request: pytest.FixtureRequest, phalanx_case: Case, tmp_path: Path
) -> Iterator[Callable[..., "LiveRun"]]:
    """Yield a function that begins a run to step through: `phalanx_testing.start`."""
    with ExitStack() as begun:

        def start(scenario: Any, **conditions: Any) -> "LiveRun":
            from phalanx_testing import start

            source, under = _conditions(request, phalanx_case, tmp_path, scenario, conditions)
            live = start(source, **under)
            begun.push(live)
            request.node.stash.setdefault(_RUNS, []).append(live)
            return live

        yield start


def _conditions(
    request: pytest.FixtureRequest, case: Case, folder: Path, scenario: Any, given: dict[str, Any]
) -> tuple[Any, dict[str, Any]]:
    """Return a run's scenario and conditions: the test's, or those of a regression's file."""
    out = {"out": given.get("out", folder / "phalanx")}
    file: Path | None = request.config.option.phalanx_scenario
    return (scenario, {**case.conditions(given), **out}) if file is None else (file, out)


@pytest.fixture
def phalanx_study() -> Callable[..., "RateStudy"]:
    """Return the class of rates over seeds: `phalanx_testing.RateStudy`."""
    from phalanx_testing import RateStudy

    return RateStudy


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Write a test's runs into junit's properties; say how to repeat the one that failed."""
    begun = item.stash.get(_RUNS, []) if call.when == "call" else []
    runs = [run.end() if hasattr(run, "end") else run for run in begun]
    item.user_properties += [
        (f"phalanx_{name}", str(getattr(run.summary, field)))
        for run in runs
        for name, field in _PROPERTIES.items()
        if run.summary is not None
    ]
    report = yield
    error = call.excinfo and call.excinfo.value
    failed = getattr(error, "run", runs[-1] if runs else None)
    if report.when == "call" and report.failed and failed and isinstance(item, pytest.Function):
        from phalanx_testing.pytest.failure import failure_lines

        lines, failed_claim = list[str](), isinstance(error, AssertionError)
        try:
            for line in failure_lines(item.config, item.nodeid, failed, failed_claim):
                lines.append(line)
        except Exception as unexpected:  # no failure of a test may end the whole session
            lines.append(f"no more is known of the run: {unexpected!r}")
        report.sections.append(("phalanx", "\n".join(lines)))
    return report


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect the scenarios of the folder of regressions, each as a test."""
    if file_path.suffix != ".toml":
        return None
    if file_path.parent not in parent.config.getini("phalanx_scenarios"):
        return None
    from phalanx_testing.pytest.regressions import RegressionFile

    collected: pytest.Collector = RegressionFile.from_parent(parent, path=file_path)
    return collected
