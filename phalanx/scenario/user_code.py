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

_trusted: ContextVar[bool] = ContextVar("trusted", default=True)
_imported: dict[str, Any] = {}
"""By name; what was imported once because somebody asked for it is used again without asking."""


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
    return _imported[name]


def _imported_now(name: str) -> Any:
    module, _, attribute = name.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    try:
        return getattr(importlib.import_module(module), attribute)
    except Exception as error:  # a user's module may raise anything while it is imported
        raise ValueError(f"cannot be imported ({type(error).__name__}: {error})") from error
