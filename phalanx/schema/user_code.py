"""Import of classes that a scenario names by "package.module:Name", if it may be imported.

Importing a module runs it. The author of a scenario wants that; the reader of a recording from
elsewhere does not, and such a file may name any module.
"""

import ast
import contextlib
import difflib
import importlib
import importlib.util
import sys
from collections.abc import Iterator
from contextvars import ContextVar
from operator import attrgetter
from pathlib import Path
from typing import Any

_trusted: ContextVar[bool] = ContextVar("trusted", default=True)
_imported: dict[str, Any] = {}
"""Classes by name; a class that was imported once is used again without trust."""
_programs: set[tuple[str, ...]] = set()
"""Commands of agents' own programs that were trusted once."""
_sources: dict[str, dict[str, bytes]] = {}
"""By module: source files by path, of it and of its imports, as they were when imported."""


class UntrustedCodeError(Exception):
    """A file names user code that may not be imported without trust; the message names it."""


@contextlib.contextmanager
def code_trusted(trust: bool) -> Iterator[None]:
    """Allow or forbid importing classes that scenarios name within this block.

    Classes that were imported before stay available.
    """
    before = _trusted.set(trust)
    try:
        yield
    finally:
        _trusted.reset(before)


def import_named(name: str) -> Any:
    """Import "package.module:Name"; the working directory is searched too.

    Raises ValueError if the import fails, UntrustedCodeError if it is not allowed.
    """
    if name not in _imported:
        _require_trust(name)
        module, _, attribute = name.partition(":")
        here = str(Path.cwd())
        if here not in sys.path:
            sys.path.append(here)
        try:
            _imported[name] = attrgetter(attribute)(importlib.import_module(module))
        except Exception as error:  # a user's module may raise anything while it is imported
            reason, hint = f"{type(error).__name__}: {error}", _hint(module, attribute)
            raise ValueError(f"cannot be imported ({reason}){hint}") from error
        _sources.setdefault(module, sources_of(module))
    return _imported[name]


def require_program(command: tuple[str, ...]) -> None:
    """Raise UntrustedCodeError unless this program may be run, or was trusted before."""
    if command not in _programs:
        _require_trust(" ".join(command))
        _programs.add(command)


def _require_trust(name: str) -> None:
    if not _trusted.get():
        raise UntrustedCodeError(
            f"names code of its own, {name}, which is not run unless you trust it: "
            "--trust, or trust=True"
        )


def _hint(module: str, attribute: str) -> str:
    """Return the module or name that was probably meant, in words; empty if none is similar."""
    imported = sys.modules.get(module)
    if imported is None:
        name, names = module, [file.stem for file in Path.cwd().glob("*.py")]
    else:
        name, names = attribute, list(vars(imported))
    close = [] if name in names else difflib.get_close_matches(name, names, n=1)
    if not close:
        return ""
    meant = f"{close[0]}:{attribute}" if imported is None else f"{module}:{close[0]}"
    file = getattr(imported, "__file__", None) or f"{close[0]}.py"
    return f"; did you mean {meant} ({Path(file).name})?"


def imported_sources(table: Any = None) -> dict[str, bytes]:
    """Return sources by path, imported for the names in a scenario's table; all by default."""
    of_table = {name.partition(":")[0] for name in _names(table)}
    modules = list(_sources) if table is None else sorted(of_table)
    return {path: text for module in modules for path, text in _sources.get(module, {}).items()}


def names_user_code(table: Any) -> bool:
    """Return whether a scenario's table names a class of a user, "package.module:Name"."""
    return any(":" in name for name in _names(table))


def of_session(table: Any) -> list[str]:
    """Return what a scenario's table names of the running script or notebook, "__main__:Name"."""
    return [name for name in _names(table) if name.startswith("__main__:")]


def _names(table: Any) -> Iterator[str]:
    """Yield every value of a field `type` in a table, at any depth."""
    if isinstance(table, dict):
        if isinstance(table.get("type"), str):
            yield table["type"]
        table = list(table.values())
    for item in table if isinstance(table, list) else ():
        yield from _names(item)


_LIBRARIES = ("site-packages", "dist-packages")
"""Folders that hold unrelated packages next to one another."""
NOT_A_USERS = sys.stdlib_module_names | {
    "phalanx",
    "phalanx_agent",
    "phalanx_plant",
    "phalanx_viewer",
}
"""Top-level modules that every installation of Phalanx has."""


def sources_of(module: str) -> dict[str, bytes]:
    """Return sources by path: an imported module and the modules of its folder that it may import.

    Paths begin at the import root, as "package/module.py". Imports are found in the syntax. Of
    installed packages only the module's own is included; files that are not Python source, or
    cannot be read, are left out.
    """
    root = _root(module)
    sources: dict[str, bytes] = {}
    waiting, visited = [module], {module}
    while root and waiting:
        name = waiting.pop()
        related = root.name not in _LIBRARIES or _top(name) == _top(module)
        if not related or _top(name) in NOT_A_USERS:
            continue
        path = name.replace(".", "/")
        for at, package in ((f"{path}/__init__.py", name), (f"{path}.py", name.rpartition(".")[0])):
            with contextlib.suppress(OSError):
                sources[at] = (root / at).read_bytes()
                new = {*_above(name), *_imported_by(sources[at], package)} - visited
                waiting += sorted(new)
                visited |= new
                break
    return sources


def _root(module: str) -> Path | None:
    """Return the import root of an imported module; None if it has no file."""
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:
        return None
    depth = module.count(".") + (Path(file).stem == "__init__")
    return Path(file).absolute().parents[depth]


def _imported_by(source: bytes, package: str) -> Iterator[str]:
    """Yield every module that a source may import, names taken from modules included."""
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
    """Yield the packages that contain a module."""
    while name := name.rpartition(".")[0]:
        yield name


def _top(name: str) -> str:
    return name.partition(".")[0]
