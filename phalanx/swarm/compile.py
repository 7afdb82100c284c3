"""Everything compiled that agents have in common, before the first sample."""

from collections.abc import Sequence

from phalanx.swarm.rows import SafetyRows
from phalanx.theory.margins.row_part import RowPart

_REHEARSED = 40
"""As many others in sight as an agent of a large swarm is made ready for."""


def compile_rows(rows: SafetyRows) -> None:
    """Compile the rows of all agents, for processes that are forked to inherit them."""
    swarm = rows.swarm
    swarm.speakers  # noqa: B018
    ends = sorted({l for both in swarm.ends for l in both})
    for i in ends:
        rows.terms(i)
    if rows.pairwise:
        _compile_pairs(rows, ends)
    for first, _ in swarm.ends:
        _rehearse(rows, first)
    swarm.links, swarm.programs, swarm.digest  # noqa: B018


def _compile_pairs(rows: SafetyRows, ends: Sequence[int]) -> None:
    swarm = rows.swarm
    obstacles = range(len(swarm.members), len(swarm.members) + len(swarm.pairs.obstacles))
    for i in ends:
        if i in swarm.normal:
            for other in (*ends, *obstacles):
                for part in RowPart if other in swarm.normal else (RowPart.WHOLE,):
                    if other != i:
                        rows.row_function(i, other, part, rows.margin(i))


def _rehearse(rows: SafetyRows, i: int) -> None:
    """Have agent i see one other, two, and so on: memory is set aside for each number once."""
    swarm, x = rows.swarm, rows.swarm.start()
    terms = rows.terms(i)
    own = rows.pair_terms(i) if rows.pairwise and i in swarm.normal else None
    others = [l for l in range(len(swarm.members)) if l != i]
    limited, most = swarm.sensing(i) is not None, min(len(others), _REHEARSED)
    for count in range(most + 1) if limited else (len(others),):
        seen = sorted((i, *others[:count]))
        if own is not None:
            own(x, seen, swarm.normal if swarm.joint else ())
        elif not rows.pairwise:
            found = terms(x, seen)
            found.psi, found.margin  # noqa: B018
