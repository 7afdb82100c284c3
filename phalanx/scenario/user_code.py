"""Classes that a scenario names by "package.module:Name", and whether they may be imported.

To import a module is to run it. Who writes a scenario and runs it asks for that; who opens a
recording that came from elsewhere does not, and a file may name any module there is.
"""

import contextlib
import importlib
import sys
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from phalanx.scenario.user_sources import sources_of

_trusted: ContextVar[bool] = ContextVar("trusted", default=True)
_imported: dict[str, Any] = {}
"""By name; what was imported once because somebody asked for it is used again without asking."""
_sources: dict[str, dict[str, bytes]] = {}
"""By module: its source and what belongs to it, by path, as they were when it was imported."""


class UntrustedCodeError(Exception):
    """A file from elsewhere names code that nobody asked to run; the message names it."""


@contextlib.contextmanager
def code_trusted(trust: bool) -> Iterator[None]:
    """Whether what scenarios name in this block may be imported, unless it was before."""
    before = _trusted.set(trust)
    try:
        yield
    finally:
        _trusted.reset(before)


def import_named(name: str) -> Any:
    """What "package.module:Name" names; the working directory is looked through too.

    Raises:
        ValueError: it cannot be imported. UntrustedCodeError: it may not be.
    """
    if name not in _imported:
        if not _trusted.get():
            raise UntrustedCodeError(
                f"names code of its own, {name}, which is not run unless you trust it: "
                "--trust, or trust=True"
            )
        _imported[name] = _imported_now(name)
        module = _module(name)
        _sources.setdefault(module, sources_of(module))
    return _imported[name]


def imported_sources(table: Any = None) -> dict[str, bytes]:
    """Source by path of what was imported for the names in a scenario's table, or for any."""
    modules = _sources if table is None else sorted(set(map(_module, _names(table))))
    return {path: text for module in modules for path, text in _sources.get(module, {}).items()}


def _names(table: Any) -> Iterator[str]:
    """Whatever stands as a type in a table, at any depth."""
    if isinstance(table, dict):
        if isinstance(table.get("type"), str):
            yield table["type"]
        table = list(table.values())
    for each in table if isinstance(table, list) else ():
        yield from _names(each)


def _module(name: str) -> str:
    return name.partition(":")[0]


def _imported_now(name: str) -> Any:
    module, _, attribute = name.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    try:
        return getattr(importlib.import_module(module), attribute)
    except Exception as error:  # a user's module may raise anything while it is imported
        raise ValueError(f"cannot be imported ({type(error).__name__}: {error})") from error
