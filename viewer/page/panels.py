"""The panels in words: how the run stands, the selected agent, the event log."""

from collections.abc import Callable

import viser

from phalanx.faults.state import Condition
from phalanx.guarantee.verdict import Assumption, Summary
from phalanx.theory.rows.origin import words_of
from phalanx.viewer.feeds.feed import Feed
from phalanx.viewer.scene.model import SceneModel
from phalanx.viewer.scene.server import in_loop
from phalanx.wire.frames import AgentStatus, Frame

_LOG_LINES = 12
_SAME_TIME = 1e-9
"""Times that differ by rounding alone [s]."""
_NO_RESIDUAL = 1e-9
"""Residuals this small are those of a row that holds with equality, but for rounding."""


class Panels:
    """Texts of a run; what they say comes from frames alone."""

    def __init__(
        self, server: viser.ViserServer, model: SceneModel, select: Callable[[int], None]
    ) -> None:
        """select is called with the index of the agent chosen here."""
        self._model, self._select = model, select
        gui = server.gui
        seed = model.scenario.seed
        gui.add_markdown(f"**{model.scenario.name}** · {_headcount(model)} · seed {seed}")
        self._status = gui.add_markdown("Waiting for the first frame.")
        self._verdict = gui.add_markdown("")
        self._selected = gui.add_dropdown("Agent", model.names)
        worst = gui.add_button("Choose from the worst pair")
        self._agent = gui.add_markdown("")
        with gui.add_folder("Event log", order=90):
            self._log = gui.add_markdown("Nothing yet.")
        self._worst_pair: int | None = None
        self._selected.on_update(in_loop(self._on_choice))
        worst.on_click(in_loop(lambda _: self._choose_worst()))

    def show_selected(self, i: int) -> None:
        """Show agent i as selected."""
        self._selected.value = self._model.names[i]  # type: ignore[misc]

    def show(self, frame: Frame, selected: int, feed: Feed) -> None:
        """Say how things stand."""
        self._worst_pair = frame.pair
        self._status.content = _status(frame, self._model.scenario.duration, feed.over)
        self._verdict.content = _verdict(frame, feed)
        self._agent.content = agent_in_words(frame.agents[selected])
        lines = [f"- `{line.t:.3f} s` {line.text}" for line in reversed(frame.log[-_LOG_LINES:])]
        self._log.content = "\n".join(lines) or "Nothing yet."

    def _on_choice(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        if event.client is not None:  # viser also calls back when show_selected() sets the value
            self._select(self._model.names.index(self._selected.value))

    def _choose_worst(self) -> None:
        if self._worst_pair is not None:
            self._select(self._model.swarm.safe_set.pairs[self._worst_pair].a)


def _headcount(model: SceneModel) -> str:
    return f"{len(model.names)} agents ({int(model.adversary.sum())} adversaries)"


def _status(frame: Frame, duration: float, over: bool) -> str:
    network = _network(frame)
    return "\n".join(
        [
            f"**t = {frame.t:.3f} s** of {duration:g} s · {_pace(frame, over)}",
            "",
            f"h_tot {frame.h_tot:.3f}, worst {frame.worst_h:.3f} · {frame.steps} steps, "
            + _empty_sets(
                sum(status.backups for status in frame.agents),
                sum(status.without_authority for status in frame.agents),
            ),
            *([f"\nnetwork by command: {network}"] if network else []),
        ]
    )


def _pace(frame: Frame, over: bool) -> str:
    if over:
        return "the run is over"
    return "paused" if frame.paused else f"{frame.real_time_factor:.2f} × real time"


def _empty_sets(backups: int, without_authority: int) -> str:
    """What became of the steps with empty K_i."""
    found = f"{backups} backup{'s' * (backups != 1)}"
    return f"{found}, {without_authority} without authority" if without_authority else found


def _network(frame: Frame) -> str:
    found = [] if frame.loss is None else [f"loss {frame.loss:.0%}"]
    return ", ".join(found + ([] if frame.delay is None else [f"delay {1e3 * frame.delay:g} ms"]))


def _verdict(frame: Frame, feed: Feed) -> str:
    """The verdict, or how it would stand now; failed assumptions in words."""
    failed = [
        f"- {a.name}: failed {_count(a)}first at {a.first:.3f} s ({a.note})"
        for a in frame.assumptions
        if a.failed and a.first is not None
    ]
    return "\n".join([outcome_in_words(frame, feed.summary, feed.unfinished), "", *failed])


def _count(assumption: Assumption) -> str:
    """How often it failed, if that is known."""
    return f"{assumption.failed} of {assumption.checked}, " if assumption.checked else ""


def outcome_in_words(frame: Frame, summary: Summary | None, unfinished: str) -> str:
    """The verdict, why there is none, or how it would stand now."""
    if unfinished:
        return f"**no verdict**: {unfinished}"
    if summary is not None and frame.t >= summary.t - _SAME_TIME:
        return f"**{summary.outcome}**: {summary.reason}"
    if frame.violations:
        worst = frame.violations[0]
        return f"**violated so far**: {worst.pair} since t = {worst.first:.3f} s"
    if any(a.failed for a in frame.assumptions):
        return "**safe so far**, not guaranteed"
    return "**guaranteed so far**"


def agent_in_words(status: AgentStatus) -> str:
    """What an agent did at its last step, and for how long that is proven safe."""
    parts = [] if status.condition == Condition.FINE else [f"**{status.condition}**"]
    if status.u:
        parts.append(f"u = ({', '.join(f'{u:.3f}' for u in status.u)}), {words_of(status.origin)}")
        parts.append(_residual(status.residual))
        parts.append(_empty_sets(status.backups, status.without_authority))
        parts.append(f"{1e3 * status.solve_time:.2f} ms")
    if status.age is not None:
        parts.append(f"oldest û {1e3 * status.age:.1f} ms")
    if status.certified is not None:
        parts.append(f"proven safe for {1e3 * status.certified:.0f} ms")
    return " · ".join(parts) or "no input yet"


def _residual(residual: float | None) -> str:
    if residual is None:
        return "no margin known"
    return f"residual {residual if abs(residual) > _NO_RESIDUAL else 0.0:.3g}"
