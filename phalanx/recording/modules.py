"""A user's Python modules in a recording: validate them, and make them importable again.

A recording may come from an attacker. Its modules are written to a temporary folder alone, and only
if the recording is trusted.
"""

import hashlib
import logging
import sys
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path, PurePosixPath

from phalanx.schema.user_code import NOT_A_USERS, imported_sources

log = logging.getLogger("phalanx.recording")

MODULES = "modules"
"""Metadata: SHA-256 by path. Each path is that of an attachment."""
MEDIA_TYPE = "text/x-python"
_MOST_BYTES = 2**20
"""Of all sources together."""


class ModulesError(ValueError):
    """Modules cannot be recorded, or taken from a recording; the message has the reason."""


def hashes(modules: Mapping[str, bytes]) -> dict[str, str]:
    """Return the SHA-256 of each source, by path. Raises ModulesError if a module is not valid."""
    total = sum(map(len, modules.values()))
    if total > _MOST_BYTES:
        raise ModulesError(f"modules: expected at most {_MOST_BYTES} bytes of source, got {total}")
    for path, source in modules.items():
        _require_module(path, source)
    return {path: hashlib.sha256(source).hexdigest() for path, source in modules.items()}


def make_importable(modules: Mapping[str, bytes], recorded: Mapping[str, str], trust: bool) -> None:
    """Make imports find the modules of a recording, unless they find the same ones already.

    Args:
        modules: source by path.
        recorded: SHA-256 by path.
        trust: whether they may be imported; if not, they are only compared with imported ones.

    Raises:
        ModulesError: they differ from their hashes, are not valid, or other modules of their
            names were imported before.
    """
    computed = hashes(modules)
    for path in sorted(computed.keys() | recorded.keys()):
        if computed.get(path) != recorded.get(path):
            raise ModulesError(f"module {path!r} is not the recorded one: SHA-256 differs")
    imported = imported_sources()
    changed = [path for path in modules if imported.get(path, modules[path]) != modules[path]]
    if trust and not changed:
        replaced = [path for path in modules if _found_here(path) != modules[path]]
        changed = [path for path in replaced if _name(path) in sys.modules]
        if replaced and not changed:
            _install(modules)
            log.warning("imported from the recording: %s", ", ".join(replaced))
    if changed:
        raise ModulesError(
            f"another {', '.join(changed)} was imported before: open it in a program of its own"
        )


def _require_module(path: str, source: bytes) -> None:
    parts = path.removesuffix(".py").split("/")
    # Identifiers alone: no ".." or drive that would lead out of the folder.
    if not path.endswith(".py") or not all(map(str.isidentifier, parts)):
        raise ModulesError(f"module {path!r}: expected the path of a module, package/module.py")
    if parts[0] in NOT_A_USERS:
        raise ModulesError(f"module {path!r}: expected none in the place of Python's or Phalanx's")
    try:
        source.decode()
    except UnicodeDecodeError as error:
        raise ModulesError(f"module {path!r}: expected UTF-8, got {error.reason}") from error


def _found_here(path: str) -> bytes | None:
    """Return the source of the module that an import finds."""
    for folder in (*sys.path, "."):
        file = Path(folder, path)
        if file.is_file():
            return file.read_bytes()
    return None


def _install(modules: Mapping[str, bytes]) -> None:
    """Write all of them, since a package lies in one folder, where imports look first."""
    # In a folder of their own, apart from the modules of other recordings.
    folder = Path(tempfile.mkdtemp(dir=_folder().name))
    try:
        for path, source in modules.items():
            file = folder / PurePosixPath(path)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(source)
    except OSError as error:
        raise ModulesError(f"modules cannot be written: {error.strerror}") from error
    # Processes of a repeated run get this path from multiprocessing.
    sys.path.insert(0, str(folder))


@cache
def _folder() -> "tempfile.TemporaryDirectory[str]":
    """Make a temporary folder that is removed with this process."""
    return tempfile.TemporaryDirectory(prefix="phalanx-modules-")


def _name(path: str) -> str:
    return path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
