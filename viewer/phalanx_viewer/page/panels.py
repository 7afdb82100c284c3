"""Text panels: the run's status and verdict, the selected agent, the event log."""

from collections.abc import Callable, Sequence

import viser

from phalanx.curves.quantities import NO_ROW
from phalanx.faults.commands import Condition
from phalanx.guarantee.verdict import Assumption, Summary
from phalanx.theory.rows.origin import origin_label
from phalanx.wire.messages import AgentStatus, Frame, LogLine
from phalanx_viewer.feeds.feed import Feed
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.overlay import Markup, Panel, element, markup
from phalanx_viewer.scene.server import in_loop

_STYLE = Markup("""<style>
.phalanx-text { margin: 0; padding: 0 0.75em 0.5em; font-size: 0.875em; line-height: 1.5;
  overflow-wrap: anywhere; white-space: pre-wrap; unicode-bidi: isolate; }
ul.phalanx-text { padding-left: 1.75em; }
</style>""")
_LOG_LINES = 12
_SAME_TIME = 1e-9
"""Times that differ by rounding alone [s]."""
_NO_RESIDUAL = 1e-9
"""Residuals this small are 0 but for rounding: the row holds with equality."""


class Panels:
    """Texts about a run, from its frames."""

    def __init__(
        self, server: viser.ViserServer, model: SceneModel, select: Callable[[int], None]
    ) -> None:
        """`select` is called with the index of the agent that a visitor chooses."""
        self._model, self._select = model, select
        gui, scenario = server.gui, model.scenario
        agents = f"{len(model.names)} agents ({int(model.adversary.sum())} adversaries)"
        Panel(gui, _text(element("b", scenario.name), f" · {agents} · seed {scenario.seed}"))
        self._status = Panel(gui, _text("Waiting for the first frame."))
        self._verdict = Panel(gui, markup())
        self._selected = gui.add_dropdown("Agent", model.names)
        worst = gui.add_button("Choose from the worst pair")
        self._agent = Panel(gui, markup())
        with gui.add_folder("Event log", order=90):
            self._log = Panel(gui, _log([]))
        self._worst_pair: int | None = None
        self._selected.on_update(in_loop(self._on_choice))
        worst.on_click(in_loop(lambda _: self._choose_worst()))

    def show_selected(self, i: int) -> None:
        self._selected.value = self._model.names[i]  # type: ignore[misc]

    def show(self, frame: Frame, selected: int, feed: Feed) -> None:
        """Show a frame's status, its selected agent and its log."""
        self._worst_pair = frame.pair
        self._status.show(_status(frame, self._model.scenario.duration, feed.over))
        self._verdict.show(verdict_text(frame, feed.summary, feed.unfinished))
        self._agent.show(_text(agent_text(frame.agents[selected])))
        self._log.show(_log(frame.log[-_LOG_LINES:]))

    def _on_choice(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        if event.client is not None:  # viser also calls back when show_selected() sets the value
            self._select(self._model.names.index(self._selected.value))

    def _choose_worst(self) -> None:
        if self._worst_pair is not None:
            self._select(self._model.swarm.safe_set.pairs[self._worst_pair].a)


def _text(*parts: str) -> Markup:
    return element("p", *parts, kind="phalanx-text")


def _items(items: Sequence[Markup]) -> Markup:
    return element("ul", *items, kind="phalanx-text") if items else markup()


def _log(lines: Sequence[LogLine]) -> Markup:
    """Lines of the event log, the newest first."""
    items = [element("li", f"{line.t:.3f} s  {line.text}") for line in reversed(lines)]
    return _items(items) if items else _text("Nothing yet.")


def _status(frame: Frame, duration: float, over: bool) -> Markup:
    clock, network = element("b", f"t = {frame.t:.3f} s"), _network(frame)
    empty = _empty_sets(
        sum(status.backups for status in frame.agents),
        sum(status.without_authority for status in frame.agents),
    )
    steps = f"{frame.steps} steps, {empty}"
    return markup(
        _STYLE,
        _text(clock, f" of {duration:g} s · {_pace(frame, over)}"),
        _text(f"h_tot {frame.h_tot:.3f}, worst {frame.worst_h:.3f} · {steps}"),
        *([_text(f"network by command: {network}")] if network else []),
    )


def _pace(frame: Frame, over: bool) -> str:
    if over:
        return "the run is over"
    return "paused" if frame.paused else f"{frame.real_time_factor:.2f} × real time"


def _empty_sets(backups: int, without_authority: int) -> str:
    counts = f"{backups} backup{'s' * (backups != 1)}"
    return f"{counts}, {without_authority} without authority" if without_authority else counts


def _network(frame: Frame) -> str:
    found = [] if frame.loss is None else [f"loss {frame.loss:.0%}"]
    return ", ".join(found + ([] if frame.delay is None else [f"delay {1e3 * frame.delay:g} ms"]))


def verdict_text(frame: Frame, summary: Summary | None, unfinished: str) -> Markup:
    """The verdict or why there is none, the outcome up to a frame, and the failures by then.

    unfinished: reason why there will be no summary; empty otherwise.
    """
    parts = []
    if unfinished:
        parts.append(_text(element("b", "no verdict"), f": {unfinished}"))
    elif summary is not None:
        parts.append(_text(element("b", summary.outcome), f": {summary.reason}"))
        if frame.t < summary.t - _SAME_TIME:
            parts.append(_interim_outcome(frame, "until now"))
    else:
        parts.append(_interim_outcome(frame, "so far"))
    failed = [_failure(a, a.first) for a in frame.assumptions if a.failed and a.first is not None]
    return markup(*parts, _items(failed))


def _failure(assumption: Assumption, first: float) -> Markup:
    count = f"{assumption.failed} of {assumption.checked}, " if assumption.checked else ""
    expected = f"; expected: {assumption.note}" if assumption.note else ""
    return element("li", f"{assumption.name} failed: {count}first at {first:.3f} s{expected}")


def _interim_outcome(frame: Frame, when: str) -> Markup:
    if frame.violations:
        worst = frame.violations[0]
        since = f": {worst.pair} since t = {worst.first:.3f} s"
        return _text(element("b", f"violated {when}"), since)
    if any(a.failed for a in frame.assumptions):
        return _text(element("b", f"safe {when}"), ", not guaranteed")
    return _text(element("b", f"guaranteed {when}"))


def agent_text(status: AgentStatus) -> Markup:
    """An agent's condition, its last step, and for how long that is proven safe."""
    fine = status.condition == Condition.FINE
    parts: list[str] = [] if fine else [element("b", status.condition)]
    step = status.step
    if step:
        parts.append(f"u = ({', '.join(f'{u:.3f}' for u in step.u)}), {origin_label(step.origin)}")
        parts.append(_residual(step.residual))
        parts.append(_empty_sets(status.backups, status.without_authority))
        parts.append(f"{1e3 * step.solve_time:.2f} ms")
    if status.lies:
        parts.append(f"{status.lies} false broadcast{'s' * (status.lies != 1)}")
    if step and step.oldest_input is not None:
        parts.append(f"oldest û {1e3 * step.oldest_input:.1f} ms")
    if step and step.certified is not None:
        parts.append(f"proven safe for {1e3 * step.certified:.0f} ms")
    return Markup(" · ".join(map(markup, parts))) or markup("no input yet")


def _residual(residual: float | None) -> str:
    if residual is None:
        return "no margin known"
    if residual <= NO_ROW:
        return "no agent or obstacle near, so no constraint"
    return f"residual {residual if abs(residual) > _NO_RESIDUAL else 0.0:.3g}"
