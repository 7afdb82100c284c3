"""The identity of a run's result: what it was computed from, by digests that are kept apart.

It has the meaning of the scenario, not its text or file; not the engine, since both give the same
bits; and not the platform, which is a column of its own.
"""

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import phalanx_agent
import phalanx_plant

import phalanx
from phalanx.scenario.model import Scenario, digest

_LIBRARIES = ("numpy", "casadi", "osqp", "pydantic")
"""Those that may change a trajectory, or the scenario that is run."""


class Identity(NamedTuple):
    """Digests of all that a row follows from; rows with equal keys are equal."""

    scenario: str
    """Of the scenario with all defaults, before its seed draws anything."""
    seed: int
    modules: str
    """Of the sources of the user's modules that the scenario imports."""
    versions: str
    """Of Phalanx's sources, and the versions of the libraries that compute."""

    @property
    def key(self) -> str:
        """One digest of all, in hexadecimal."""
        return _digest(list(self))

    def changed(self, other: "Identity") -> list[str]:
        """Name the inputs in which another identity differs."""
        pairs = zip(_INPUTS, self, other, strict=True)
        return [name for name, mine, theirs in pairs if mine != theirs]


_INPUTS = ("the scenario", "the seed", "your modules", "versions")


def digest_of_scenario(scenario: Scenario) -> str:
    """Return the digest of a scenario, without what no run depends on."""
    return digest(scenario.model_copy(update={"seed": 0, "description": "", "attack": None}))


def digest_of_modules(sources: Mapping[str, bytes]) -> str:
    """Return the digest of sources by path."""
    return _digest({path: hashlib.sha256(text).hexdigest() for path, text in sources.items()})


@cache
def versions_of_libraries() -> dict[str, str]:
    """Return the versions of the libraries that compute, and the digest of Phalanx's sources."""
    sources: dict[str, str] = {}
    for package in (phalanx, phalanx_agent, phalanx_plant):
        folder = Path(package.__path__[0])
        for file in sorted(folder.rglob("*.py")):
            name = f"{package.__name__}/{file.relative_to(folder).as_posix()}"
            sources[name] = hashlib.sha256(file.read_bytes()).hexdigest()
    return {name: version(name) for name in _LIBRARIES} | {"phalanx": _digest(sources)}


@cache
def versions() -> str:
    """Return one digest of versions_of_libraries."""
    return _digest(versions_of_libraries())


def _digest(value: Any) -> str:
    text = json.dumps(value, sort_keys=True).encode()
    return hashlib.blake2b(text, digest_size=12).hexdigest()
