"""A search in a folder: begun, or gone on with, and always left readable."""

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w
from phalanx_studies.pool import Pool
from phalanx_studies.store import Store, StudyError

from phalanx.scenario.attack import Attack
from phalanx.scenario.load import load, read_table
from phalanx_attacks.archive import Behaviour, Find, write_finds
from phalanx_attacks.knobs import WITHIN, preset, space_of
from phalanx_attacks.page import write_attack_page
from phalanx_attacks.search import History, Options, Search, declaration

DECLARATION, PAGE = "attack.toml", "attack.html"


@dataclass(frozen=True)
class Attacked:
    """A search as far as it went."""

    histories: list[History]
    finds: list[tuple[Behaviour, Find, Path]]
    """Written as files."""
    page: Path


def attack(
    source: str,
    overrides: Mapping[str, Any],
    options: Options,
    *,
    folder: Path,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Callable[[History], object] = lambda _: None,
) -> Attacked:
    """Search for attacks on a scenario; what the folder has already is not run again.

    Args:
        source: a scenario as phalanx.load takes it.
        overrides: by path.
        options: of the search.
        folder: of the search.
        workers: of the built-in pool; by default one for each processor.
        executor: in place of the pool.
        progress: called with the optimiser's history at its begin, and after each run.

    Raises:
        ScenarioError: the scenario or its [attack] table is not valid.
        StudyError: the folder has another search, or is in use.
        ImportError: the optimiser is not installed.
    """
    table = read_table(source, overrides)
    if options.preset or "attack" not in table:
        table["attack"] = _with_preset(table, options.preset or WITHIN)
    space, knobs = space_of(table, source), Attack.model_validate(table["attack"])
    rows_of = {"optimiser": options.optimiser, "seed": options.seed, "fresh": options.fresh}
    rows_of |= {} if options.batch is None else {"batch": options.batch}
    store = _opened(folder, tomli_w.dumps(declaration(space, knobs, rows_of)))
    with store, nullcontext(executor) if executor else Pool(workers) as computing:
        search = Search(space, knobs, store, computing, options, progress)
        try:
            for optimiser in options.optimisers:
                search.run(optimiser)
            return _written(search, folder)
        except BaseException:
            # Until all rows of last time have come up again, its files show more.
            if not search.unseen:
                _written(search, folder)
            raise


def _written(search: Search, folder: Path) -> Attacked:
    finds = list(write_finds(folder, search.space.table, search.archive.best_first))
    page = write_attack_page(search, finds, folder / PAGE)
    return Attacked(search.histories, finds, page)


def _with_preset(table: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the [attack] table of a scenario with the knobs of a preset; declared ones stay."""
    added, declared = preset(name, load(table)), table.get("attack", {})
    both = {field: {**added[field], **declared.get(field, {})} for field in ("starts", "vary")}
    return {**added, **declared, **both}


def _opened(folder: Path, text: str) -> Store:
    file = folder / DECLARATION
    if file.exists() and file.read_text(encoding="utf-8") != text:
        raise StudyError(
            f"{folder}: has a search of another scenario, or with other options: take another "
            "folder with --out, or delete this one"
        )
    return Store(folder).open_with(DECLARATION, text)
