"""Classes that a scenario names by "package.module:Name", and whether they may be imported.

To import a module is to run it. Who writes a scenario and runs it asks for that; who opens a
recording that came from elsewhere does not, and a file may name any module there is.
"""

import ast
import contextlib
import importlib
import importlib.util
import sys
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any

_trusted: ContextVar[bool] = ContextVar("trusted", default=True)
_imported: dict[str, Any] = {}
"""By name; what was imported once because somebody asked for it is used again without asking."""
_sources: dict[str, dict[str, bytes]] = {}
"""By module: its source and what belongs to it, by path, as they were when it was imported."""


class UntrustedCodeError(Exception):
    """A file from elsewhere names code that nobody asked to run; the message names it."""


@contextlib.contextmanager
def code_trusted(trust: bool) -> Iterator[None]:
    """Say whether names in scenarios may be imported in this block, unless they were before."""
    before = _trusted.set(trust)
    try:
        yield
    finally:
        _trusted.reset(before)


def import_named(name: str) -> Any:
    """Import "package.module:Name"; the working directory is looked through too.

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


_LIBRARIES = ("site-packages", "dist-packages")
"""Folders where packages lie among others that have nothing to do with them."""
NOT_A_USERS = sys.stdlib_module_names | {
    "phalanx",
    "phalanx_agent",
    "phalanx_plant",
    "phalanx_viewer",
}
"""Top-level modules that are wherever Phalanx is."""


def sources_of(module: str) -> dict[str, bytes]:
    """Source by path of an imported module, and of those of the same folder that it may import.

    Paths begin at the folder that imports begin in, as "package/module.py". Imports are read off
    the syntax. Of an installed package only the package is taken; what is not Python source, or
    cannot be read, is left out.
    """
    root = _root(module)
    found: dict[str, bytes] = {}
    waiting, seen = [module], {module}
    while root and waiting:
        name = waiting.pop()
        related = root.name not in _LIBRARIES or _top(name) == _top(module)
        if not related or _top(name) in NOT_A_USERS:
            continue
        path = name.replace(".", "/")
        for at, package in ((f"{path}/__init__.py", name), (f"{path}.py", name.rpartition(".")[0])):
            with contextlib.suppress(OSError):
                found[at] = (root / at).read_bytes()
                new = {*_above(name), *_imported_by(found[at], package)} - seen
                waiting += sorted(new)
                seen |= new
                break
    return found


def _root(module: str) -> Path | None:
    """The folder that an imported module was found from; None if it has no file."""
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:
        return None
    depth = module.count(".") + (Path(file).stem == "__init__")
    return Path(file).absolute().parents[depth]


def _imported_by(source: bytes, package: str) -> Iterator[str]:
    """Every module that a source may import; names that it takes from modules are among them."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):  # the file was changed since it was imported
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level <= len(package.split(".")) * bool(
            package
        ):
            base = "." * node.level + (node.module or "")
            base = importlib.util.resolve_name(base, package) if node.level else base
            names = [base, *(f"{base}.{alias.name}" for alias in node.names)]
        else:
            continue
        for name in names:
            yield from (name, *_above(name))


def _above(name: str) -> Iterator[str]:
    """The packages that a module is in."""
    while name := name.rpartition(".")[0]:
        yield name


def _top(name: str) -> str:
    return name.partition(".")[0]
