"""Finds as files: each is a plain scenario, which `phalanx run` repeats to the same hash."""

import copy
from collections.abc import Iterator
from pathlib import Path

from phalanx.attacks.archive import Behaviour, Find
from phalanx.attacks.knobs import Fields
from phalanx.guarantee.verdict import Outcome
from phalanx.scenario.load import scenario_text, set_field

FOLDER = "found"


def table_of(base: Fields, find: Find) -> Fields:
    """Return the scenario of a find: the base with what the search changed."""
    table = copy.deepcopy(base)
    for path, value in find.row.overrides.items():
        set_field(table, path, value)
    return {**table, "seed": find.row.identity.seed}


def write_finds(
    folder: Path, base: Fields, archived: list[tuple[Behaviour, Find]]
) -> Iterator[tuple[Behaviour, Find, Path]]:
    """Write every violated run of the archive as a file, or without one the best; yield them.

    Files of an earlier state of the search are removed. Raises OSError.
    """
    own = folder / FOLDER
    own.mkdir(exist_ok=True)
    for old in own.glob("*.toml"):
        old.unlink()
    violated = [each for each in archived if each[1].row.outcome == Outcome.VIOLATED]
    for number, (behaviour, find) in enumerate(violated or archived[:1], 1):
        name = f"{number:02d}-{behaviour.pair.replace(' ', '-')}-{find.when:.2f}s.toml"
        path = own / name
        path.write_text(text_of(base, behaviour, find, path), encoding="utf-8")
        yield behaviour, find, path


def text_of(base: Fields, behaviour: Behaviour, find: Find, path: Path) -> str:
    """Return a find as a TOML file, with comments that say what it shows."""
    row = find.row
    lines = [
        f"{row.outcome}: {row.reason}",
        f"Evaluation {find.number} of a search; weakest is {behaviour.pair}, robustness "
        f"{find.robustness:.4g}, by {behaviour.means}.",
        f"On fresh seeds: violated with {find.fresh_violated} of {len(find.fresh)}.",
        f"Trajectory: {row.trajectory}",
        f"Run it: phalanx run {path} --engine in-process",
    ]
    return "".join(f"# {line}\n" for line in lines) + "\n" + scenario_text(table_of(base, find))
