"""The panels in words: how the run stands, the selected agent, the event log."""

from collections.abc import Callable, Sequence

import viser

from phalanx.curves.quantities import NOBODY_NEAR
from phalanx.faults.commands import Condition
from phalanx.guarantee.verdict import Assumption, Summary
from phalanx.theory.rows.origin import words_of
from phalanx.wire.messages import AgentStatus, Frame, LogLine
from phalanx_viewer.feeds.feed import Feed
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.overlay import Markup, Panel, element, markup
from phalanx_viewer.scene.server import in_loop

_STYLE = Markup("""<style>
.phalanx-words { margin: 0; padding: 0 0.75em 0.5em; font-size: 0.875em; line-height: 1.5;
  overflow-wrap: anywhere; white-space: pre-wrap; unicode-bidi: isolate; }
ul.phalanx-words { padding-left: 1.75em; }
</style>""")
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
        gui, scenario = server.gui, model.scenario
        told = element("b", scenario.name), f" · {_headcount(model)} · seed {scenario.seed}"
        Panel(gui, _words(*told))
        self._status = Panel(gui, _words("Waiting for the first frame."))
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
        """Show agent i as selected."""
        self._selected.value = self._model.names[i]  # type: ignore[misc]

    def show(self, frame: Frame, selected: int, feed: Feed) -> None:
        """Say how things stand."""
        self._worst_pair = frame.pair
        self._status.show(_status(frame, self._model.scenario.duration, feed.over))
        self._verdict.show(verdict_in_words(frame, feed.summary, feed.unfinished))
        self._agent.show(_words(agent_in_words(frame.agents[selected])))
        self._log.show(_log(frame.log[-_LOG_LINES:]))

    def _on_choice(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        if event.client is not None:  # viser also calls back when show_selected() sets the value
            self._select(self._model.names.index(self._selected.value))

    def _choose_worst(self) -> None:
        if self._worst_pair is not None:
            self._select(self._model.swarm.safe_set.pairs[self._worst_pair].a)


def _headcount(model: SceneModel) -> str:
    return f"{len(model.names)} agents ({int(model.adversary.sum())} adversaries)"


def _words(*parts: str) -> Markup:
    return element("p", *parts, kind="phalanx-words")


def _items(items: Sequence[Markup]) -> Markup:
    return element("ul", *items, kind="phalanx-words") if items else markup()


def _log(lines: Sequence[LogLine]) -> Markup:
    """The last line first."""
    items = [element("li", f"{line.t:.3f} s  {line.text}") for line in reversed(lines)]
    return _items(items) if items else _words("Nothing yet.")


def _status(frame: Frame, duration: float, over: bool) -> Markup:
    clock, network = element("b", f"t = {frame.t:.3f} s"), _network(frame)
    empty = _empty_sets(
        sum(status.backups for status in frame.agents),
        sum(status.without_authority for status in frame.agents),
    )
    steps = f"{frame.steps} steps, {empty}"
    return markup(
        _STYLE,
        _words(clock, f" of {duration:g} s · {_pace(frame, over)}"),
        _words(f"h_tot {frame.h_tot:.3f}, worst {frame.worst_h:.3f} · {steps}"),
        *([_words(f"network by command: {network}")] if network else []),
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


def verdict_in_words(frame: Frame, summary: Summary | None, unfinished: str) -> Markup:
    """The verdict or why there is none, how things stood at a frame, and what had failed by then.

    Args:
        frame: the moment shown.
        summary: of the run, once there is one.
        unfinished: why there will be none; empty otherwise.
    """
    told = []
    if unfinished:
        told.append(_words(element("b", "no verdict"), f": {unfinished}"))
    elif summary is not None:
        told.append(_words(element("b", summary.outcome), f": {summary.reason}"))
        if frame.t < summary.t - _SAME_TIME:
            told.append(_standing(frame, "until now"))
    else:
        told.append(_standing(frame, "so far"))
    failed = [_failure(a, a.first) for a in frame.assumptions if a.failed and a.first is not None]
    return markup(*told, _items(failed))


def _failure(assumption: Assumption, first: float) -> Markup:
    count = f"{assumption.failed} of {assumption.checked}, " if assumption.checked else ""
    expected = f"; expected was: {assumption.note}" if assumption.note else ""
    return element("li", f"{assumption.name} failed: {count}first at {first:.3f} s{expected}")


def _standing(frame: Frame, when: str) -> Markup:
    if frame.violations:
        worst = frame.violations[0]
        since = f": {worst.pair} since t = {worst.first:.3f} s"
        return _words(element("b", f"violated {when}"), since)
    if any(a.failed for a in frame.assumptions):
        return _words(element("b", f"safe {when}"), ", not guaranteed")
    return _words(element("b", f"guaranteed {when}"))


def agent_in_words(status: AgentStatus) -> Markup:
    """What an agent did at its last step, and for how long that is proven safe."""
    fine = status.condition == Condition.FINE
    parts: list[str] = [] if fine else [element("b", status.condition)]
    step = status.step
    if step:
        parts.append(f"u = ({', '.join(f'{u:.3f}' for u in step.u)}), {words_of(step.origin)}")
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
    if residual <= NOBODY_NEAR:
        return "nobody near, so no row to keep"
    return f"residual {residual if abs(residual) > _NO_RESIDUAL else 0.0:.3g}"
