"""Break a room's code in small ways, one at a time, and see whether its nearest tests notice.

    python -m tests.hostile.break_room ROOM [--sample N]

Tests are collected once, in a copy of the sources, and run in a fork for each mutant: those alone
that run the statement that is changed, the fastest first. The room `by-hand` is the table of
`mutants.py`, all of which must be killed; of others LEAST. `tonight` is another room each day.
Exits with 1 if too many survived.
"""

import argparse
import ast
import importlib
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from itertools import groupby
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from rich.progress import Progress

from tests.hostile.drawn_mutants import Place, difference, drawn, equivalents
from tests.hostile.forks import COLLECTING, NOT_IN_PLACE, Executed, Forks, Lines, running
from tests.hostile.mutants import MUTANTS, ROOT, broken
from tests.hostile.rooms import ROOMS

BY_HAND, TONIGHT = "by-hand", "tonight"
LEAST = 0.9
"""Share of a room's mutants that its tests must notice."""
KILLED, SURVIVED, TIMEOUT = "killed", "SURVIVED", "timeout"
_OUTCOMES = {None: TIMEOUT, 0: SURVIVED}
"""By pytest's status; none if it was ended."""
_SHORT = 0.25
"""Seconds of a core for a test that uses what others set up."""
_LIBRARIES = "casadi cmaes hypothesis mcap msgspec osqp pydantic scipy.sparse typer zenoh"


class Mutant(NamedTuple):
    """A file's text with a mistake in it, where it is, and what pytest is called with."""

    what: str
    file: str
    lines: Place
    text: str
    tests: str

    def __str__(self) -> str:
        old, new = (text.replace("\n", "\n  ") for text in self.lines[1:])
        return f"{self.file}:{self.lines.number}: {self.what}\n- {old}\n+ {new}"


class Room:
    """A room's mutants, a copy of all sources, and what tests run there without a mutant."""

    def __init__(self, folder: Path, mutants: list[Mutant]) -> None:
        self._copy, self._mutants = folder / "copy", sorted(mutants, key=lambda m: m.tests)
        self._files = {mutant.file for mutant in mutants}
        _copy_sources(self._copy)
        self._executed: dict[str, dict[str, Executed]] = {}

    def run_clean(self) -> None:
        """Run the tests of all mutants without one. Raises RuntimeError if they fail."""
        for tests in dict.fromkeys(mutant.tests for mutant in self._mutants):
            with running(self._copy, tests, Lines, self._copy, self._files) as (process, pipe):
                with suppress(EOFError):
                    self._executed[tests] = pipe.recv()
                process.join()
            if process.exitcode:
                log = self._copy.with_suffix(".log").read_text()
                raise RuntimeError(f"without a mutant: {tests}\n{log[-3000:]}")

    def outcomes(self) -> Iterator[tuple[Mutant, str]]:
        """Run the tests with each mutant, one after the other; yield each with how it ended."""
        for tests, mutants in groupby(self._mutants, lambda mutant: mutant.tests):
            with running(self._copy, tests, Forks) as (_, pipe):
                for mutant in mutants:
                    file = self._copy / mutant.file
                    clean = file.read_text("utf-8")
                    file.write_text(mutant.text, "utf-8")
                    yield mutant, self._outcome(mutant, clean, pipe)
                    file.write_text(clean, "utf-8")

    def _outcome(self, mutant: Mutant, clean: str, collected: Connection) -> str:
        """Test a mutant; what fails must fail twice, since a busy machine fails tests by itself."""
        status = self._status(mutant, clean, collected)
        return _OUTCOMES.get(status and self._status(mutant, clean, collected), KILLED)

    def _status(self, mutant: Mutant, clean: str, collected: Connection) -> Any:
        """Test a mutant in a fork of what is collected, or again where that ran what is changed."""
        tests, is_early = self._nearest(mutant, clean)
        executed = self._executed[mutant.tests]
        limit, status = 30 + int(5.0 * sum(executed[test][0] for test in tests)), NOT_IN_PLACE
        if not is_early:
            change = str(self._copy / mutant.file), clean, mutant.text
            status = _answer(collected, tests, limit, change)
        files = [*dict.fromkeys(map(_file, tests))] if status == NOT_IN_PLACE else []
        for some in filter(None, (files[:1], files[1:])):
            with running(self._copy, " ".join(some), Forks) as (_, anew):
                if status := _answer(anew, tests, limit, None):
                    break
        return status

    def _nearest(self, mutant: Mutant, clean: str) -> tuple[list[str], bool]:
        """Return the tests that run what a mutant changes, or all if none does, the fastest first.

        Tests of a file share what they set up: those that took little time are run as well. And
        return whether collecting runs it, so that what follows from it has to be collected again.
        """
        executed = self._executed[mutant.tests]
        if not mutant.file.endswith(".py"):  # each test compiles it
            return sorted(executed.keys() - {COLLECTING}), True
        lines = _run_with(clean, mutant, self._copy, self._files)
        running = {test for test, by in executed.items() if any(lines[f] & by[1][f] for f in lines)}
        is_early = COLLECTING in running
        tests = running - {COLLECTING} or executed.keys() - {COLLECTING}
        files = {_file(test) for test in tests}
        short = {t for t, by in executed.items() if _file(t) in files and by[0] < _SHORT}
        return sorted(tests | short, key=lambda test: executed[test][0]), is_early


def _answer(pipe: Connection, *request: Any) -> Any:
    """Return pytest's status, 1 if it ends before: what is changed cannot be imported."""
    try:
        pipe.send(request)
        return pipe.recv()
    except (EOFError, ConnectionError):
        return 1


def _run_with(text: str, mutant: Mutant, folder: Path, files: set[str]) -> dict[str, set[int]]:
    """Return lines by file of which one at least is run where what a mutant changes matters.

    They are those of its statement; outside functions those that name what it defines.
    """
    line, rows = mutant.lines.number, text.splitlines()
    statements = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.stmt))
    around = [node for node in statements if node.lineno <= line <= (node.end_lineno or 0)]
    if any(isinstance(n, ast.FunctionDef) and n.body[0].lineno <= line for n in around):
        is_simple = not hasattr(around[-1], "body") and not hasattr(around[-1], "cases")
        whole = range(around[-1].lineno, (around[-1].end_lineno or 0) + 1)
        return {mutant.file: {line, *(whole if is_simple else ())}}
    first = r"\s*(?:class |async def |def )?(\w*)"
    names = "|".join(re.match(first, rows[node.lineno - 1])[1] for node in around)
    named = re.compile(rf"\b({names})\b" if names else "$^")
    return {
        file: {i for i, row in enumerate((folder / file).open(), 1) if named.search(row)}
        for file in files
    }


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
        for mutant, outcome in room.outcomes():
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
