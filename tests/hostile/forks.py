"""Runs of pytest in a copy of the sources, in processes forked from this one, and from each other.

One collects tests once, and runs some in a fork for each request, with a changed text put in the
place of functions that live. One notes which lines each test runs.
"""

import gc
import multiprocessing
import os
import resource
import shlex
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from inspect import CO_OPTIMIZED
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkProcess
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import Any

import pytest

from tests.hostile.mutants import ROOT

NOT_IN_PLACE = 99
"""A fork's status if a change needs that tests are collected anew."""
COLLECTING = "collecting"
"""In place of a test's name: what is run before all."""
Executed = tuple[float, dict[str, set[int]]]
"""What a test took in seconds of a core, and the lines by file that it ran."""
Functions = dict[str, list[FunctionType]]
_OPTIONS = "-x -q --tb=line --timeout 0 -p no:xdist -p no:cacheprovider -m 'not nightly'"
_OURS = "agent", "plant", "viewer"
_LIMITS = {resource.RLIMIT_AS: 8 * 2**30, resource.RLIMIT_FSIZE: 2**30}
"""Bytes that a mutant's process may use, and write into a file."""
_WAITING = 10
"""How many seconds may pass for each that a mutant's process may compute."""


class Forks:
    """A plugin of pytest that collects tests once, and runs some in a fork for each request.

    A request is the names of tests in their order, a limit in seconds of a core, and what in_place
    takes. A busy machine makes a fork wait: the limit by the clock is for one that sleeps.
    """

    def __init__(self, requests: Connection) -> None:
        self._requests = requests
        sys.dont_write_bytecode = True
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool | None:
        """Answer requests by pytest's status; return none in a fork, where pytest goes on."""
        items, functions = {item.nodeid: item for item in session.items}, _living_functions()
        while True:
            try:
                tests, limit, change = self._requests.recv()
            except EOFError:
                os._exit(0)
            if not (process := os.fork()):
                break
            watched = os.pidfd_open(process)
            # A pipe that is closed ends the fork with the process that asked for it.
            has_ended = watched in wait([watched, self._requests], _WAITING * limit)
            os.close(watched)
            with suppress(ProcessLookupError):
                os.killpg(process, signal.SIGKILL)
            status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
            self._requests.send(status if has_ended and status != -signal.SIGXCPU else None)
        os.setpgid(0, 0)
        resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.RLIM_INFINITY))
        shutil.rmtree(tempfile.gettempdir())
        os.mkdir(tempfile.gettempdir())
        if change and not in_place(functions, *change):
            os._exit(NOT_IN_PLACE)
        session.items[:] = [items[test] for test in tests if test in items]
        return None


class Lines:
    """A plugin of pytest that sends what each test, and collecting, runs of some files."""

    def __init__(self, answers: Connection, folder: Path, files: set[str]) -> None:
        self._answers, self._files = answers, {f"{folder}/{file}": file for file in files}
        self._executed: dict[str, Executed] = {}
        self._begin()

    def _begin(self) -> None:
        self._lines: dict[str, set[int]] = {file: set() for file in self._files.values()}
        self._begun = time.process_time()
        threading.settrace(self._see)
        sys.settrace(self._see)

    def _see(self, frame: FrameType, _event: str, _: object) -> Any:
        if file := self._files.get(frame.f_code.co_filename):
            self._lines[file].add(frame.f_lineno)
            return self._see
        return None

    def _end(self, name: str) -> None:
        sys.settrace(None)
        self._executed[name] = time.process_time() - self._begun, self._lines

    def pytest_collection_finish(self) -> None:
        self._end(COLLECTING)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._begin()
        try:
            return (yield)
        finally:
            self._end(item.nodeid)

    def pytest_sessionfinish(self) -> None:
        self._answers.send(self._executed)


@contextmanager
def running(
    copy: Path, tests: str, plugin: type, *arguments: object
) -> Iterator[tuple[ForkProcess, Connection]]:
    """Run pytest in a copy of the sources; yield its process, and the pipe to its plugin."""
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("fork").Process(
        target=_test, args=(copy, tests, plugin, theirs, *arguments)
    )
    process.start()
    theirs.close()
    try:
        yield process, ours
    finally:
        ours.close()
        process.join(1.0)
        with suppress(ProcessLookupError):
            os.killpg(process.pid or 0, signal.SIGKILL)
        process.join()


def _test(copy: Path, tests: str, plugin: type, *arguments: object) -> None:
    os.setpgid(0, 0)
    for kind, most in _LIMITS.items():
        resource.setrlimit(kind, (most, resource.getrlimit(kind)[1]))
    with copy.with_suffix(".log").open("wb") as log, open(os.devnull, "rb") as none:
        for number, file in enumerate((none, log, log)):
            os.dup2(file.fileno(), number)
    sys.stdout = sys.stderr = open(1, "w", closefd=False)  # noqa: SIM115
    folders = copy, *(copy / name for name in _OURS), *copy.glob("packages/phalanx-*")
    paths = [*map(str, folders)]
    temporary = copy.with_suffix(".tmp")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir()
    tempfile.tempdir = str(temporary)
    os.environ.update(PYTHONPATH=os.pathsep.join(paths), TMPDIR=str(temporary))
    sys.path[:] = [*paths, *(path for path in sys.path if path not in ("", str(ROOT)))]
    os.chdir(copy)
    for name in [name for name in sys.modules if name.split(".")[0] == "tests"]:
        del sys.modules[name]
    status = pytest.main(shlex.split(f"{_OPTIONS} {tests}"), [plugin(*arguments)])
    sys.stdout.flush()
    os._exit(status)


def _living_functions() -> Functions:
    """Return all functions by file, those too that the collector of garbage leaves alone."""
    gc.unfreeze()
    functions: Functions = defaultdict(list)
    for function in gc.get_objects():
        if type(function) is FunctionType:
            functions[function.__code__.co_filename].append(function)
    gc.freeze()
    return functions


def in_place(functions: Functions, file: str, old: str, new: str) -> bool:
    """Give a file's functions the code of its changed text; return False if more is changed.

    What is not imported needs nothing: the file has the changed text.
    """
    if not any(getattr(module, "__file__", None) == file for module in list(sys.modules.values())):
        return True
    before, after = ([*_codes(compile(text, file, "exec"))] for text in (old, new))
    changed = [(a, b) for a, b in zip(before, after, strict=False) if _alone(a) != _alone(b)]
    if len(before) != len(after) or not all(a.co_flags & CO_OPTIMIZED for a, _ in changed):
        return False
    codes = {_place(a): b for a, b in changed}
    living = [function for function in functions[file] if _place(function.__code__) in codes]
    for function in living:
        function.__code__ = codes[_place(function.__code__)]
    return bool(living)


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _alone(code: CodeType) -> CodeType:
    """Leave out a module's and a class's functions, which are no part of what it does itself."""
    if code.co_flags & CO_OPTIMIZED:
        return code
    constants = [c for c in code.co_consts if not isinstance(c, CodeType)]
    return code.replace(co_consts=tuple(constants))


def _place(code: CodeType) -> tuple[Any, ...]:
    return code.co_name, code.co_firstlineno, *code.co_positions()
