"""The archive of a search: the best attack of each behaviour, not one best point.

A behaviour is the weakest pair, when it was weakest, and by what means. Each becomes a file, a
plain scenario, which `phalanx run` repeats to the same hash.
"""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from phalanx_studies.row import Row
from phalanx_studies.statistics import Interval, clopper_pearson

from phalanx.guarantee.verdict import Outcome
from phalanx.native.files import real_folder, whole_file
from phalanx.scenario.load import read_table, scenario_text
from phalanx_attacks.knobs import Fields
from phalanx_attacks.robustness import START, robustness_of

_PARTS = 8
"""Parts of a run's duration."""


class Behaviour(NamedTuple):
    """A kind of attack."""

    pair: str
    """The label of the weakest pair."""
    part: int
    """The eighth of the run in which it was unsafe, lost its certificate, or was closest."""
    means: str
    """Kinds of the faults that had an effect; "motion" without one."""


class Find(NamedTuple):
    """A run of a search."""

    number: int
    """Its number in the search, from 1 on."""
    row: Row
    robustness: float
    fresh: tuple[Row, ...] = ()
    """The same on fresh seeds."""

    @property
    def fresh_violated(self) -> int:
        """The number of fresh seeds with which it is violated as well."""
        return sum(row.outcome == Outcome.VIOLATED for row in self.fresh)

    @property
    def fresh_interval(self) -> Interval | None:
        """95 % interval of the probability of a violation; None without fresh seeds."""
        return clopper_pearson(self.fresh_violated, len(self.fresh)) if self.fresh else None

    @property
    def when(self) -> float:
        """The time of the violation, else of the lost certificate, else of the largest h [s]."""
        row = self.row
        times = (row.first_violation, row.uncovered_at, row.worst_at)
        return next((t for t in times if t is not None), 0.0)


def find_of(number: int, row: Row) -> Find:
    """Return a row as a find."""
    return Find(number, row, min(robustness_of(row).values(), default=float("inf")))


def behaviour(find: Find, duration: float) -> Behaviour | None:
    """Return the behaviour of a run; None if it did not begin."""
    robustness = robustness_of(find.row)
    if START in robustness or not robustness:
        return None
    pair = min(robustness, key=robustness.__getitem__)
    kinds = re.findall(r"faults\.\d+ \(([\w-]+)\)", find.row.faults)
    part = min(int(_PARTS * find.when / duration), _PARTS - 1)
    return Behaviour(pair, part, " + ".join(sorted(set(kinds))) or "motion")


class Archive:
    """The best run of each behaviour."""

    def __init__(self, duration: float) -> None:
        """duration: of the runs [s]."""
        self._duration = duration
        self.cells: dict[Behaviour, Find] = {}

    def add(self, find: Find) -> bool:
        """Keep a run if it is the best of its behaviour; return whether it is."""
        cell = behaviour(find, self._duration)
        if cell is None or (cell in self.cells and self.cells[cell].robustness <= find.robustness):
            return False
        self.cells[cell] = find
        return True

    def confirm(self, find: Find, fresh: Iterable[Row]) -> None:
        """Keep the rows of a run on fresh seeds, if it is still the best of its behaviour."""
        cell = behaviour(find, self._duration)
        if cell is not None and self.cells[cell].number == find.number:
            self.cells[cell] = find._replace(fresh=tuple(fresh))

    @property
    def best_first(self) -> list[tuple[Behaviour, Find]]:
        """All behaviours, the least robust first."""
        return sorted(self.cells.items(), key=lambda entry: (entry[1].robustness, entry[1].number))


def table_of(base: Fields, find: Find) -> Fields:
    """Return the scenario of a find: the base with what the search changed."""
    return {**read_table(base, find.row.overrides), "seed": find.row.identity.seed}


def write_finds(
    folder: Path, base: Fields, archived: list[tuple[Behaviour, Find]]
) -> Iterator[tuple[Behaviour, Find, Path]]:
    """Write every violated run of the archive as a file, or without one the best; yield them.

    Files of an earlier state of the search are removed. Raises OSError.
    """
    subfolder = real_folder(folder / "found")
    for old in subfolder.glob("*.toml"):
        old.unlink()
    violated = [entry for entry in archived if entry[1].row.outcome == Outcome.VIOLATED]
    for number, (behaviour, find) in enumerate(violated or archived[:1], 1):
        name = f"{number:02d}-{behaviour.pair.replace(' ', '-')}-{find.when:.2f}s.toml"
        path = subfolder / name
        with whole_file(path) as part:
            part.write_text(text_of(base, behaviour, find, path), encoding="utf-8")
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
