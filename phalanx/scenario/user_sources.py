"""Source of a user's module, and of what it imports from its own folder."""

import ast
import contextlib
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path

_LIBRARIES = ("site-packages", "dist-packages")
"""Folders where packages lie beside others that have nothing to do with them."""
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
        beside = root.name not in _LIBRARIES or _top(name) == _top(module)
        if not beside or _top(name) in NOT_A_USERS:
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
