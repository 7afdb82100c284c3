"""Panels: status, verdict, the selected agent, the event log; and commands to a live run."""

from collections.abc import Callable, Sequence

import viser

from phalanx.faults.commands import EFFECTS, CommandKind, Condition
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.messages.frames import AgentStatus, Frame, LogLine
from phalanx.recording.curves.series import NO_ROW
from phalanx.theory.rows.origin import origin_label
from phalanx_viewer.feeds import Feed, interim_outcome
from phalanx_viewer.feeds.live import Live
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.server import Callback, in_loop
from phalanx_viewer.scene.texts import Markup, Panel, element, markup

_LOG_LINES = 12
_SAME_TIME = 1e-9
"""Times that differ by rounding alone [s]."""
_NO_RESIDUAL = 1e-9
"""Residuals this small are 0 but for rounding: the row holds with equality."""
_SPEEDS = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""To choose from, as of CommandKind.SPEED."""


class Panels:
    """Texts about a run, from its frames."""

    def __init__(self, gui: viser.GuiApi, model: SceneModel, select: Callable[[int], None]) -> None:
        """`select` is called with the index of the agent that the visitor chooses."""
        self._model, self._select = model, select
        scenario = model.scenario
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

    def show(self, frame: Frame, selected: int, feed: Feed, past: bool) -> None:
        """Show a frame's status, its selected agent and its log; past: of a run that goes on."""
        self._worst_pair = frame.pair
        self._status.show(_status(frame, self._model.scenario.duration, feed.over, past))
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


def _list(items: Sequence[Markup]) -> Markup:
    return element("ul", *items, kind="phalanx-text") if items else markup()


def _log(lines: Sequence[LogLine]) -> Markup:
    """Lines of the event log, the newest first."""
    items = [element("li", f"{line.t:.3f} s  {line.text}") for line in reversed(lines)]
    return _list(items) or _text("Nothing yet.")


def _status(frame: Frame, duration: float, over: bool, past: bool) -> Markup:
    pace = (
        "looking back"
        if past
        else "paused"
        if frame.paused
        else f"{frame.real_time_factor:.2f} × real time"
    )
    empty = _empty_sets(
        sum(status.backups for status in frame.agents),
        sum(status.without_authority for status in frame.agents),
    )
    commanded = [] if frame.loss is None else [f"loss {frame.loss:.0%}"]
    commanded += [] if frame.delay is None else [f"delay {1e3 * frame.delay:g} ms"]
    clock = element("b", f"t = {frame.t:.3f} s")
    return markup(
        _text(clock, f" of {duration:g} s · {'the run is over' if over else pace}"),
        _text(f"worst h so far {frame.worst_h:.3f}, h_tot {frame.h_tot:.3f}"),
        _text(f"{frame.steps} steps, {empty}"),
        *([_text(f"network by command: {', '.join(commanded)}")] if commanded else []),
    )


def _empty_sets(backups: int, without_authority: int) -> str:
    counts = f"{backups} backup{'s' * (backups != 1)}"
    return f"{counts}, {without_authority} without authority" if without_authority else counts


def verdict_text(frame: Frame, summary: Summary | None, unfinished: str) -> Markup:
    """The verdict or why there is none, the outcome up to a frame, and the failures by then.

    unfinished: reason why there will be no summary; empty otherwise.
    """
    parts = []
    if unfinished:
        parts.append(_text(element("b", "no verdict"), f": {unfinished}"))
    elif summary is not None:
        parts.append(_text(element("b", summary.outcome), f": {summary.reason}"))
        parts += [_text(summary.on_theorem)] if summary.on_theorem else []
        if frame.t < summary.t - _SAME_TIME:
            parts.append(_interim_outcome(frame, "until now"))
    else:
        parts.append(_interim_outcome(frame, "so far"))
    failed = []
    for a in frame.assumptions:
        if a.failed and a.first is not None:
            count = f"{a.failed} of {a.checked}, " if a.checked else ""
            expected = f"; expected: {a.note}" if a.note else ""
            text = f"{a.name} failed: {count}first at {a.first:.3f} s{expected}"
            failed.append(element("li", text))
    return markup(*parts, _list(failed))


def _interim_outcome(frame: Frame, when: str) -> Markup:
    outcome, more = interim_outcome(frame), ""
    if outcome == Outcome.VIOLATED:
        worst = frame.violations[0]
        more = f": {worst.pair} from t = {worst.first:.3f} s on"
    elif outcome == Outcome.SAFE:
        more = ", not guaranteed"
    return _text(element("b", f"{outcome} {when}"), more)


def agent_text(status: AgentStatus) -> Markup:
    """An agent's condition, its last step, and for how long that is proven safe."""
    fine = status.condition == Condition.FINE
    parts: list[str] = [] if fine else [element("b", status.condition)]
    step, lies = status.step, status.lies
    if step:
        parts.append(f"u = ({', '.join(f'{u:.3f}' for u in step.u)}), {origin_label(step.origin)}")
        parts.append(_residual(step.residual))
        parts.append(_empty_sets(status.backups, status.without_authority))
        parts.append(f"{1e3 * step.solve_time:.2f} ms")
    if lies:
        parts.append(f"{lies} false broadcast{'s' * (lies != 1)}")
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


class CommandPanel:
    """One visitor's command panel."""

    def __init__(self, gui: viser.GuiApi, live: Live, selected: str) -> None:
        """`selected` is the agent that the visitor chose."""
        self._live = live
        self.folder = gui.add_folder("Command", order=10)
        with self.folder:
            self._pause = gui.add_button_group("Run", ("Pause", "Resume", "Step"))
            self._step = gui.add_number("Step [s]", 0.01, min=0.001, max=10.0, step=0.001)
            self._speed = gui.add_dropdown("Speed", ("",))
            self._loss = gui.add_slider("Loss [%]", min=0, max=100, step=1, initial_value=0)
            self._delay = gui.add_slider("Delay [ms]", min=0, max=500, step=1, initial_value=0)
            self._agent = gui.add_button_group("Agent", _on_agent(selected))
        self._speeds = dict[str, float]()
        self._last: tuple[float | None, ...] = None, None, None
        """Loss, delay and speed in the last frame."""

        def command(kind: CommandKind, value: Callable[[], float]) -> Callback:
            # Only for visitors: viser also calls back when show() sets a value.
            return in_loop(lambda e: live.command(kind, value=value()) if e.client else None)

        def command_agent(_: object) -> None:
            # The agent that the visitor read on the button, even if another was chosen since.
            kind, _, name = self._agent.value.partition(" ")
            live.command(CommandKind(kind.lower()), agent=name)

        self._pause.on_click(in_loop(lambda _: self._command_pace()))
        self._agent.on_click(in_loop(command_agent))
        self._speed.on_update(command(CommandKind.SPEED, lambda: self._speeds[self._speed.value]))
        self._loss.on_update(command(CommandKind.LOSS, lambda: self._loss.value / 100.0))
        self._delay.on_update(command(CommandKind.DELAY, lambda: self._delay.value / 1000.0))

    def show_selected(self, selected: str) -> None:
        """Make the buttons command another agent."""
        self._agent.options = _on_agent(selected)

    def show(self, frame: Frame) -> None:
        """Set the fields to the plant's loss, delay and speed."""
        # Only what changed: otherwise a slider that a visitor has just moved would jump back before
        # the command is sent, and the command would carry the old value.
        loss, delay, speed = self._last
        if frame.loss is not None and frame.loss != loss:
            self._loss.value = round(100.0 * frame.loss)  # type: ignore[misc]
        if frame.delay is not None and frame.delay != delay:
            self._delay.value = round(1000.0 * frame.delay)  # type: ignore[misc]
        if frame.speed != speed:
            speeds = sorted({*_SPEEDS, frame.speed} - ({0.0} if self._live.real_time else set()))
            names = [f"{s:g} ×" if s else "as fast as possible" for s in speeds]
            self._speeds = dict(zip(names, speeds, strict=True))
            self._speed.options = tuple(names)
            self._speed.value = names[speeds.index(frame.speed)]  # type: ignore[misc]
        self._last = frame.loss, frame.delay, frame.speed

    def _command_pace(self) -> None:
        kind = CommandKind(self._pause.value.lower())
        self._live.command(kind, value=self._step.value if kind == CommandKind.STEP else 0.0)


def _on_agent(name: str) -> tuple[str, ...]:
    """Commands to an agent, as the buttons name them."""
    return tuple(f"{kind.title()} {name}" for kind in EFFECTS)
