"""The panels in words: how the run stands, the chosen agent, the event log."""

from collections.abc import Callable

import viser

from phalanx.guarantee.verdict import Summary
from phalanx.viewer.scene.model import SceneModel
from phalanx.viewer.scene.picture import COLOURS, Role
from phalanx.wire.frames import Condition, Frame

_LINES = 12


class Panels:
    """Texts of a run; what they say comes from frames alone."""

    def __init__(
        self, server: viser.ViserServer, cast: SceneModel, select: Callable[[int], None]
    ) -> None:
        """select is called with the index of the agent chosen here."""
        self._cast = cast
        gui = server.gui
        gui.add_markdown(f"**{cast.scenario.name}** · {_headcount(cast)} · seed {_seed(cast)}")
        self._status = gui.add_markdown("Waiting for the first frame.")
        self._verdict = gui.add_markdown("")
        self._chosen = gui.add_dropdown("Agent", cast.names)
        self._agent = gui.add_markdown("")
        with gui.add_folder("Event log", order=90):
            self._log = gui.add_markdown("Nothing yet.")
        with gui.add_folder("Colours", expand_by_default=False, order=95):
            gui.add_html(_legend())

        @self._chosen.on_update
        def _(event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
            if event.client is not None:
                select(cast.names.index(self._chosen.value))

    def choose(self, i: int) -> None:
        """Show agent i as chosen."""
        self._chosen.value = self._cast.names[i]  # type: ignore[misc]

    def show(self, frame: Frame, chosen: int, summary: Summary | None, over: bool) -> None:
        """Say how things stand."""
        self._status.content = _status(frame, self._cast, over)
        self._verdict.content = _verdict(frame, summary)
        self._agent.content = _agent(frame, chosen)
        lines = [f"- `{line.t:.3f} s` {line.text}" for line in reversed(frame.log[-_LINES:])]
        self._log.content = "\n".join(lines) or "Nothing yet."


def _headcount(cast: SceneModel) -> str:
    adversaries = int(cast.adversary.sum())
    return f"{len(cast.names)} agents ({adversaries} adversaries)"


def _seed(cast: SceneModel) -> int:
    return cast.scenario.seed


def _status(frame: Frame, cast: SceneModel, over: bool) -> str:
    pace = "the run is over" if over else "paused" if frame.paused else (
        f"{frame.real_time_factor:.2f} × real time"
    )  # fmt: skip
    return "\n".join(
        [
            f"**t = {frame.t:.3f} s** of {cast.scenario.duration:g} s · {pace}",
            "",
            f"h_tot {frame.h_tot:.3f}, worst {frame.worst_h:.3f} · {frame.steps} steps, "
            f"{sum(shown.backups for shown in frame.agents)} backups",
            *([f"\nnetwork by hand: {_network(frame)}"] if _network(frame) else []),
        ]
    )


def _network(frame: Frame) -> str:
    found = [] if frame.loss is None else [f"loss {frame.loss:.0%}"]
    return ", ".join(found + ([] if frame.delay is None else [f"delay {1e3 * frame.delay:g} ms"]))


def _verdict(frame: Frame, summary: Summary | None) -> str:
    """The verdict, or how it would stand now; failed assumptions in words."""
    if summary is not None and frame.t >= summary.t - 1e-9:
        head = f"**{summary.outcome}**: {summary.reason}"
    elif frame.violations:
        worst = frame.violations[0]
        head = f"**violated so far**: {worst.pair} since t = {worst.first:.3f} s"
    elif any(a.failed for a in frame.assumptions):
        head = "**safe so far**, not guaranteed"
    else:
        head = "**guaranteed so far**"
    failed = [a for a in frame.assumptions if a.failed]
    lines = [
        f"- {a.name}: failed {a.failed} of {a.checked}, first at {a.first:.3f} s ({a.note})"
        for a in failed
        if a.first is not None
    ]
    return "\n".join([head, "", *lines])


def _agent(frame: Frame, i: int) -> str:
    shown = frame.agents[i]
    parts = [] if shown.condition == Condition.FINE else [f"**{shown.condition}**"]
    if shown.u:
        parts.append(f"u = ({', '.join(f'{u:.3f}' for u in shown.u)}) by {shown.origin}")
        parts.append(f"residual {shown.residual:.3g}")
        parts.append(f"{shown.backups} backups")
        parts.append(f"{1e3 * shown.solve_time:.2f} ms")
    if shown.age is not None:
        parts.append(f"oldest û {1e3 * shown.age:.1f} ms")
    return " · ".join(parts) or "no input yet"


def _legend() -> str:
    rows = [
        f'<div><span style="color:rgb{COLOURS[role]}">&#9632;</span> {role}</div>' for role in Role
    ]
    rows.append("<div>dark arrow: applied input, light arrow: nominal input</div>")
    rows.append("<div>link lines: amber late, red lost</div>")
    return f'<div style="padding:0 1em;font-size:0.85em">{"".join(rows)}</div>'
