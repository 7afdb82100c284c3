"""The reasons of an input that is not the wish: in sentences, as a table and as JSON."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from phalanx.guarantee.row_terms import ALLOWANCE
from phalanx.recording.read import Recording
from phalanx.theory.rows.origin import origin_label
from phalanx.theory.rows.row import Rows
from phalanx_explain.advice import Advice, advice
from phalanx_explain.conflict import given_up, least_conflict
from phalanx_explain.costs import RowCost, row_costs
from phalanx_explain.repetition import ControllerSteps, repeated

_SMALL = 1e-6
"""Inputs that are shown as 0."""
_TELLING = 1e-3
"""Costs below this share of the largest are left out of sentences."""
_MOST_ROWS, _MOST_ADVICE = 3, 4
"""Described in sentences."""


@dataclass(frozen=True)
class Explanation:
    """One control step of one agent, explained."""

    agent: str
    t: float
    """Time of the sample [s]."""
    wish: tuple[float, ...]
    """The law's input, or the nearest to it in U_i."""
    u: tuple[float, ...]
    """The applied input."""
    origin: str
    rows: tuple[RowCost, ...]
    """All rows, those that the wish violates most first."""
    conflict: tuple[tuple[str, float], ...]
    """The fewest rows that exclude one another, and what each would have to give."""
    advice: tuple[Advice, ...] | None
    """None if none was looked for."""

    @property
    def binding(self) -> tuple[RowCost, ...]:
        """The rows that keep the wish from being applied."""
        return tuple(row for row in self.rows if row.binds)

    def sentences(self) -> list[str]:
        """Describe the step in at most twelve sentences."""
        about = f"Agent {self.agent} at t = {self.t:.4g} s"
        wish, u = (_numbers(values) for values in (self.wish, self.u))
        if np.allclose(self.wish, self.u, rtol=_SMALL, atol=_SMALL):
            return [f"{about} applied what its law wanted, {u}: no row held it back."]
        lines = [f"{about} wanted {wish} and applied {u} ({origin_label(self.origin)})."]
        if self.conflict:
            names = ", ".join(f"{name} by {by:.3g}" for name, by in self.conflict)
            lines.append(f"These rows exclude one another; each would have to give: {names}.")
        if not self.binding:
            lines.append("No row binds: the input lies at the bounds that its actuators have.")
        lines += [_of_row(row) for row in self.binding[:_MOST_ROWS]]
        if more := self.binding[_MOST_ROWS:]:
            lines.append(f"So do rows of {', '.join(row.other for row in more)}.")
        if self.advice:
            lines.append("Each of these alone would have let it apply its wish:")
            lines += [f"  {change}" for change in self.advice[:_MOST_ADVICE]]
        elif self.advice is not None and self.binding:
            lines.append("No single field of those that may change would have freed it.")
        return lines

    def table(self) -> list[tuple[str, ...]]:
        """Return each term of each binding row: other, part, term, cost, and that in metres."""
        return [
            (row.other, row.part, term, f"{cost:.4g}", _metres(row, term))
            for row in self.binding or self.rows[:1]
            for term, cost in row.terms.items()
        ]

    def as_json(self) -> dict[str, Any]:
        """Return the sentences and all numbers, of all rows."""
        rows = [
            {"other": row.other, "part": row.part, "binds": row.binds, "excess": row.excess,
             "slack": row.slack, "terms": dict(row.terms), "metres": row.in_metres()}
            for row in self.rows
        ]  # fmt: skip
        changes = self.advice and [change._asdict() for change in self.advice]
        words = {"sentences": self.sentences()}
        return {**asdict(self), **words, "rows": rows, "advice": changes}


def explain(recording: Recording, agent: str, t: float, changes: bool = True) -> Explanation:
    """Explain an agent's last control step at or before t [s].

    changes: whether to look for what would free it, which takes seconds for each field.

    Raises EngineError: the run cannot be repeated, or no row made that input.
    """
    steps = repeated(recording, agent, t)
    return explained(steps, changes)


def explained(steps: ControllerSteps, changes: bool = True) -> Explanation:
    """Explain the last of an agent's repeated steps."""
    result, now = steps.result, steps.steps[-1]
    assert result is not None
    costs = row_costs(steps)
    wish, u = (tuple(v.tolist()) for v in (steps.wish, result.decision.u))
    free = not any(row.binds for row in costs)
    return Explanation(
        agent=steps.rows.swarm.names[steps.i],
        t=now.t,
        wish=wish,
        u=u,
        origin=result.decision.origin.value,
        rows=tuple(costs),
        conflict=tuple(_conflict(steps, costs)),
        advice=tuple(advice(steps)) if changes and not free else None,
    )


def _conflict(steps: ControllerSteps, costs: list[RowCost]) -> list[tuple[str, float]]:
    """The fewest rows that exclude one another, by name, with what each would have to give."""
    rows = [cost for cost in costs if cost.a is not None]
    if not rows:
        return []
    now = steps.steps[-1]
    inputs = steps.rows.seen_by(steps.i).terms(steps.i)(now.x, now.seen).polytopes[steps.i]
    every = Rows(np.array([row.a for row in rows]), np.array([row.bound for row in rows]))
    chosen = least_conflict(inputs, every)
    if not chosen:
        return []
    violations = given_up(inputs, every, chosen).tolist()
    return [(rows[k].other, by) for k, by in zip(chosen, violations, strict=True)]


def _of_row(row: RowCost) -> str:
    """One sentence on a row: its largest costs, in metres if there is such a distance."""
    in_metres = row.in_metres()
    costs, unit = (in_metres, " m") if in_metres else (row.terms, "")
    least = _TELLING * max(costs.values())
    largest = sorted(((cost, term) for term, cost in costs.items() if cost > least), reverse=True)
    terms = ", ".join(f"{cost:.3g}{unit} for {term}" for cost, term in largest)
    allowed = -costs.get(ALLOWANCE, 0.0)
    allowance = f"; α allows {allowed:.3g}{unit}" if allowed > 0.0 else ""
    return f"The row of {row.other} ({row.part}) binds: {terms}{allowance}."


def _metres(row: RowCost, term: str) -> str:
    metres = row.in_metres().get(term)
    return "" if metres is None else f"{metres:.4g} m"


def _numbers(values: tuple[float, ...]) -> str:
    shown = (0.0 if abs(value) < _SMALL else value for value in values)
    return "(" + ", ".join(f"{value:.3g}" for value in shown) + ")"
