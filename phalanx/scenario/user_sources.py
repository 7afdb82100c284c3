"""Source of a user's module, and of what it imports from its own folder."""

import ast
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import NamedTuple

_LIBRARIES = ("site-packages", "dist-packages")
"""Folders where packages lie beside others that have nothing to do with them."""
NOT_A_USERS = sys.stdlib_module_names | {"phalanx"}
"""Top-level modules that are wherever Phalanx is."""


class _Source(NamedTuple):
    path: str
    """Below the folder that imports begin in, as "package/module.py"."""
    root: Path
    """That folder."""
    text: bytes
    package: str


def sources_of(module: str) -> dict[str, bytes]:
    """Source by path of an imported module, and of those that it imports from the same folder.

    Their imports are read off their syntax. Of an installed package only the package is taken;
    what is not Python source, or cannot be read, is left out.
    """
    named = _source(module)
    found: dict[str, bytes] = {}
    waiting, seen = [module], {module}
    while named and waiting:
        name = waiting.pop()
        source = _source(name)
        beside = named.root.name not in _LIBRARIES or _top(name) == _top(module)
        if source is None or source.root != named.root or not beside:
            continue
        found[source.path] = source.text
        new = {*_above(name), *_imported_by(source)} - seen
        waiting += sorted(new)
        seen |= new
    return found


def _source(name: str) -> _Source | None:
    module = sys.modules.get(name)
    file = Path(getattr(module, "__file__", None) or "")
    if _top(name) in NOT_A_USERS or file.suffix != ".py":
        return None
    inside = ["__init__"] if file.stem == "__init__" else []
    path = PurePosixPath(*name.split("."), *inside).with_suffix(".py")
    try:
        text = file.read_bytes()
    except OSError:
        return None
    package = getattr(module, "__package__", None) or ""
    return _Source(str(path), file.absolute().parents[len(path.parts) - 1], text, package)


def _imported_by(source: _Source) -> Iterator[str]:
    """Every module that a source may import; names that it takes from modules are among them."""
    try:
        tree = ast.parse(source.text)
    except (SyntaxError, ValueError):  # the file was changed since it was imported
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            if node.level and not source.package:
                continue
            base = importlib.util.resolve_name(base, source.package)
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
