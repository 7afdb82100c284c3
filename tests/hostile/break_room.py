"""Break a room's code in small ways, one at a time, and see whether its nearest tests notice.

    python -m tests.hostile.break_room ROOM [--sample N] [--workers N]

Each mutant runs in a process of its own, forked from this one, which has the libraries, in a copy
of the sources. Tests that call the function that was changed come first. The room `by-hand` is the
table of `mutants.py`, all of which must be killed; of others LEAST. `tonight` is another room each
day. Exits with 1 if too many survived.
"""

import argparse
import importlib
import json
import multiprocessing
import os
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from multiprocessing.connection import wait
from multiprocessing.context import ForkProcess
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

import pytest
from rich.progress import Progress

from tests.hostile.drawn_mutants import Lines, difference, drawn, equivalents
from tests.hostile.mutants import MUTANTS, ROOT, broken
from tests.hostile.rooms import ROOMS

BY_HAND, TONIGHT = "by-hand", "tonight"
LEAST = 0.9
"""Share of a room's mutants that its tests must notice."""
KILLED, SURVIVED, TIMEOUT = "killed", "SURVIVED", "timeout"
_OUTCOMES = {None: TIMEOUT, 0: SURVIVED}
"""By pytest's status; none if it was ended."""
_LIBRARIES = "casadi cmaes hypothesis mcap msgspec osqp pydantic scipy.sparse typer zenoh"
_PATHS = (
    "", "agent", "plant", "viewer",
    *(f"packages/phalanx-{name}" for name in ("attacks", "certify", "hosts", "worlds")),
)  # fmt: skip
_LIMITS = {resource.RLIMIT_AS: 8 * 2**30, resource.RLIMIT_FSIZE: 2**30}
"""Bytes that a mutant's process may use, and write into a file."""


class Mutant(NamedTuple):
    """A file's text with a mistake in it, where it is, and what pytest is called with."""

    what: str
    file: str
    lines: Lines
    text: str
    tests: str

    def __str__(self) -> str:
        old, new = (text.replace("\n", "\n  ") for text in self.lines[1:])
        return f"{self.file}:{self.lines.number}: {self.what}\n- {old}\n+ {new}"


class Entered(NamedTuple):
    """The functions of ours that a test called: file, first line, last line."""

    seconds: float
    functions: list[tuple[str, int, int]]


class Order:
    """A plugin of pytest: tests that call a changed function first, the fastest of them first."""

    def __init__(self, seconds: dict[str, float]) -> None:
        self._seconds = seconds
        sys.dont_write_bytecode = True
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items.sort(key=lambda item: self._seconds.get(item.nodeid, float("inf")))


class Calls:
    """A plugin of pytest that writes which functions of a folder each test calls."""

    def __init__(self, folder: Path, file: Path) -> None:
        self._folder, self._file = f"{folder}/", file
        self._entered: dict[str, Entered] = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        codes: set[CodeType] = set()
        begun = time.monotonic()

        def see(frame: Any, event: str, _: object) -> None:
            if event == "call":
                codes.add(frame.f_code)

        threading.setprofile(see)
        sys.setprofile(see)
        try:
            return (yield)
        finally:
            sys.setprofile(None)
            functions = [
                (code.co_filename.removeprefix(self._folder), code.co_firstlineno, max(lines))
                for code in codes.copy()  # a thread may add still
                if code.co_filename.startswith(self._folder)
                and (lines := [line for *_, line in code.co_lines() if line])
            ]
            self._entered[item.nodeid] = Entered(time.monotonic() - begun, functions)

    def pytest_sessionfinish(self) -> None:
        self._file.write_text(json.dumps(self._entered))


class Run:
    """A run of tests in a copy of the sources, in a process of its own."""

    def __init__(self, copy: Path, tests: str, plugin: type, *arguments: object) -> None:
        self.log, self._begun = copy.with_suffix(".log"), time.monotonic()
        self.process: ForkProcess = multiprocessing.get_context("fork").Process(
            target=self._test, args=(copy, tests, plugin, *arguments)
        )
        self.process.start()

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._begun

    def end(self) -> int | None:
        """End all that the tests started; return pytest's status, or none if it ran still."""
        status = self.process.exitcode
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.join()
        return status

    def _test(self, copy: Path, tests: str, plugin: type, *arguments: object) -> None:
        os.setsid()
        for kind, most in _LIMITS.items():
            resource.setrlimit(kind, (most, resource.getrlimit(kind)[1]))
        with self.log.open("wb") as log, open(os.devnull, "rb") as none:
            for number, file in enumerate((none, log, log)):
                os.dup2(file.fileno(), number)
        sys.stdout = sys.stderr = open(1, "w", closefd=False)  # noqa: SIM115
        paths = [str(copy / name) for name in _PATHS]
        temporary = copy.with_suffix(".tmp")
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir()
        tempfile.tempdir = str(temporary)
        os.environ.update(PYTHONPATH=os.pathsep.join(paths), TMPDIR=str(temporary))
        sys.path[:] = [*paths, *(path for path in sys.path if path not in ("", str(ROOT)))]
        os.chdir(copy)
        for name in [name for name in sys.modules if name.split(".")[0] == "tests"]:
            del sys.modules[name]
        options = ["-x", "-q", "-p", "no:xdist", "-p", "no:cacheprovider", "-m", "not nightly"]
        status = pytest.main([*options, *shlex.split(tests)], [plugin(*arguments)])
        sys.stdout.flush()
        os._exit(status)


class Room:
    """A room's mutants, and what is known from runs of its tests without one."""

    def __init__(self, folder: Path, mutants: list[Mutant]) -> None:
        self._folder, self._mutants = folder, mutants
        self._clean = folder / "clean"
        _copy_sources(self._clean)
        self._entered: dict[str, dict[str, Entered]] = {}

    def run_clean(self) -> None:
        """Run the tests of all mutants without one. Raises RuntimeError if they fail."""
        for tests in dict.fromkeys(mutant.tests for mutant in self._mutants):
            calls = self._folder / "calls.json"
            run = Run(self._clean, tests, Calls, self._clean, calls)
            try:
                run.process.join()
            finally:
                status = run.end()
            if status:
                raise RuntimeError(f"without a mutant: {tests}\n{run.log.read_text()[-3000:]}")
            self._entered[tests] = {
                test: Entered(*entered) for test, entered in json.loads(calls.read_text()).items()
            }

    def outcomes(self, workers: int) -> Iterator[tuple[Mutant, str]]:
        """Run the tests with each mutant, a few at a time; yield each with how it ended."""
        free = [self._folder / f"worker-{i}" for i in range(workers)]
        for copy in free:
            shutil.copytree(self._clean, copy)
        running: dict[Path, tuple[Mutant, Run, float]] = {}
        waiting = self._mutants[::-1]
        try:
            while waiting or running:
                while waiting and free:
                    mutant, copy = waiting.pop(), free.pop()
                    (copy / mutant.file).write_text(mutant.text, "utf-8")
                    tests, first, limit = self._nearest(mutant)
                    running[copy] = mutant, Run(copy, tests, Order, first), limit
                wait([run.process.sentinel for _, run, _ in running.values()], timeout=1.0)
                for copy, (mutant, run, limit) in list(running.items()):
                    if run.seconds > limit or run.process.exitcode is not None:
                        yield mutant, _OUTCOMES.get(run.end(), KILLED)
                        shutil.copy2(self._clean / mutant.file, copy / mutant.file)
                        del running[copy]
                        free.append(copy)
        finally:
            for _, run, _ in running.values():
                run.end()

    def _nearest(self, mutant: Mutant) -> tuple[str, dict[str, float], float]:
        """Return the files of the tests that call what a mutant changes, or all if none does.

        With the seconds of those tests, and a limit in seconds: tests of a file share what they
        set up, so that all are run.
        """
        entered = self._entered[mutant.tests]
        calling = {
            test: seconds
            for test, (seconds, functions) in entered.items()
            for file, first, last in functions
            if file == mutant.file and first <= mutant.lines.number <= last
        }
        files = {_file(test) for test in calling or entered}
        limit = 20.0 + 3.0 * sum(e.seconds for test, e in entered.items() if _file(test) in files)
        return " ".join(sorted(files)), calling, limit


def _file(test: str) -> str:
    return test.partition("::")[0]


def _copy_sources(folder: Path) -> None:
    listed = ("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard")
    for name in subprocess.check_output(listed, cwd=ROOT, text=True).split("\0"):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def mutants_of(room: str, sample: int) -> list[Mutant]:
    """Return the mutants of a room, without those that no test can notice."""
    if room == BY_HAND:
        texts = [(mutant.what, mutant.file, broken(mutant), mutant.tests) for mutant in MUTANTS]
    else:
        texts = [
            (type(change.operator).__name__, change.file, change.text(), ROOMS[room].tests)
            for change in drawn(room, ROOMS[room], sample)
        ]
    mutants = [
        Mutant(what, file, difference((ROOT / file).read_text("utf-8"), text), text, tests)
        for what, file, text, tests in texts
    ]
    excused = {(e["file"], e["line"], e["becomes"]) for e in equivalents()}
    return [m for m in mutants if (m.file, m.lines.old, m.lines.new) not in excused]


def main() -> None:
    """Break one room, with a progress bar; print each mutant that survived, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("room", choices=[*ROOMS, BY_HAND, TONIGHT])
    parser.add_argument("--sample", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    name = options.room
    if name == TONIGHT:
        name = [*ROOMS][datetime.now(UTC).toordinal() % len(ROOMS)]
        print(f"Tonight's room: {name}", flush=True)
    for library in _LIBRARIES.split():
        importlib.import_module(library)
    counts: Counter[str] = Counter()
    # A thread that draws would be lost in each process that is forked.
    with tempfile.TemporaryDirectory() as folder, Progress(auto_refresh=False) as progress:
        mutants = mutants_of(name, options.sample)
        task = progress.add_task(name, total=len(mutants))
        room = Room(Path(folder).resolve(), mutants)
        room.run_clean()
        for mutant, outcome in room.outcomes(options.workers):
            counts[outcome] += 1
            if outcome != KILLED:
                progress.console.print(
                    f"{outcome} {mutant}", markup=False, highlight=False, soft_wrap=True
                )
            progress.update(task, advance=1, refresh=True)
    print(
        f"{name}: {counts.total()} mutants, {counts[KILLED]} killed, "
        f"{counts[TIMEOUT]} by a time limit, {counts[SURVIVED]} survived"
    )
    least = 1.0 if name == BY_HAND else LEAST
    sys.exit(counts.total() - counts[SURVIVED] < least * counts.total())


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("stopped")
