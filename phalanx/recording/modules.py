"""A user's modules in a recording: which may be in it, and how they are put to use again.

Whoever sends a recording chooses what is in it. Nothing is written outside a temporary folder, and
nothing at all unless the recording is trusted.
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
_MOST = 2**20
"""All sources together [bytes]."""


class ModulesError(ValueError):
    """Modules that are not recorded, or not taken from a recording; the message says why."""


def hashes(modules: Mapping[str, bytes]) -> dict[str, str]:
    """SHA-256 of each source, by path. Raises ModulesError unless they may be in a recording."""
    total = sum(map(len, modules.values()))
    if total > _MOST:
        raise ModulesError(f"modules: expected at most {_MOST} bytes of source, got {total}")
    for path, source in modules.items():
        _require_module(path, source)
    return {path: hashlib.sha256(source).hexdigest() for path, source in modules.items()}


def put_to_use(modules: Mapping[str, bytes], recorded: Mapping[str, str], trust: bool) -> None:
    """Have the modules of a recording imported, unless those that are found here are the same.

    Args:
        modules: source by path.
        recorded: SHA-256 by path.
        trust: whether they may be imported; if not, they are only compared with what was.

    Raises:
        ModulesError: they are not what a recording holds, or others of their names were imported.
    """
    found = hashes(modules)
    for path in sorted(found.keys() | recorded.keys()):
        if found.get(path) != recorded.get(path):
            raise ModulesError(f"module {path!r} is not the recorded one: SHA-256 differs")
    imported = imported_sources()
    changed = [path for path in modules if imported.get(path, modules[path]) != modules[path]]
    if trust and not changed:
        replaced = [path for path in modules if _found_here(path) != modules[path]]
        changed = [path for path in replaced if _name(path) in sys.modules]
        if replaced and not changed:
            _place(modules)
            log.warning("as recorded, and not as found here: %s", ", ".join(replaced))
    if changed:
        raise ModulesError(
            f"another {', '.join(changed)} was imported before: open it in a program of its own"
        )


def _require_module(path: str, source: bytes) -> None:
    parts = path.removesuffix(".py").split("/")
    # Identifiers alone: neither "..", nor a drive, nor anything else that leads out of a folder.
    if not path.endswith(".py") or not all(map(str.isidentifier, parts)):
        raise ModulesError(f"module {path!r}: expected the path of a module, package/module.py")
    if parts[0] in NOT_A_USERS:
        raise ModulesError(f"module {path!r}: expected none in the place of Python's or Phalanx's")
    try:
        source.decode()
    except UnicodeDecodeError as error:
        raise ModulesError(f"module {path!r}: expected UTF-8, got {error.reason}") from error


def _found_here(path: str) -> bytes | None:
    """Source of the module that an import finds at present."""
    for folder in (*sys.path, "."):
        file = Path(folder, path)
        if file.is_file():
            return file.read_bytes()
    return None


def _place(modules: Mapping[str, bytes]) -> None:
    """Write all of them where imports look first: a package lies in one folder."""
    # In a folder of their own: the modules of another recording stay what they are.
    folder = Path(tempfile.mkdtemp(dir=_folder().name))
    try:
        for path, source in modules.items():
            file = folder / PurePosixPath(path)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(source)
    except OSError as error:
        raise ModulesError(f"modules cannot be written: {error.strerror}") from error
    # Processes of a run that is made again get this path from multiprocessing.
    sys.path.insert(0, str(folder))


@cache
def _folder() -> "tempfile.TemporaryDirectory[str]":
    """It goes away with this process."""
    return tempfile.TemporaryDirectory(prefix="phalanx-modules-")


def _name(path: str) -> str:
    return path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
