"""Real runs of plant, hub and agents, in a folder that goes away."""

import contextlib
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from phalanx.guarantee.verdict import Summary
from phalanx.launcher.launch import launch, new_folder
from phalanx.recording.read import Recording, read
from phalanx.scenario.load import load
from phalanx.wire.session import free_endpoint


def run(name: str, overrides: Sequence[str] = (), seed: int | None = None) -> Recording:
    """A run as it was recorded. Raises LaunchError if there is no verdict."""
    with finished(name, overrides, seed) as (folder, _):
        return read(folder)


def outcome(name: str, overrides: Sequence[str] = (), seed: int | None = None) -> Summary:
    """What a run came to. Raises LaunchError if there is no verdict."""
    with finished(name, overrides, seed) as (_, summary):
        return summary


@contextlib.contextmanager
def finished(
    name: str, overrides: Sequence[str] = (), seed: int | None = None
) -> Iterator[tuple[Path, Summary]]:
    """The folder of a run, and what it came to."""
    with tempfile.TemporaryDirectory(prefix="phalanx-") as parent:
        folder = new_folder(Path(parent), name)
        summary = launch(load(name, overrides, seed), folder, free_endpoint(), lambda _: None)
        yield folder, summary
