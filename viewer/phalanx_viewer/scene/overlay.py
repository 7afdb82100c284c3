"""Text over the scene, and the HTML of all texts on the page."""

from html import escape

import viser

from phalanx_viewer.scene.colours import COLOURS, DANGER, LATE, LIE, WORST_PAIR, Colour, Role


class Markup(str):
    """HTML that was made here; any other string is text, to be escaped."""

    __slots__ = ()


def markup(*parts: str) -> Markup:
    """Join parts; those that are text are escaped."""
    return Markup("".join(p if isinstance(p, Markup) else escape(p) for p in parts))


def element(tag: str, *parts: str, kind: str = "", **attributes: str) -> Markup:
    """An HTML element around parts; kind: its class."""
    named = {"class": kind} if kind else {}
    shown = "".join(f' {name}="{escape(value)}"' for name, value in (named | attributes).items())
    return Markup(f"<{tag}{shown}>{markup(*parts)}</{tag}>")


class Panel:
    """A part of the page that holds markup."""

    def __init__(self, gui: viser.GuiApi, content: Markup, order: float | None = None) -> None:
        self._html = gui.add_html(str(content), order=order)

    def show(self, content: Markup) -> None:
        if content != self._html.content:
            self._html.content = str(content)  # plain: viser sends no other strings


_LINES = 3
"""Most pairs that the banner names; all are in the event log."""
_STYLE = Markup("""<style>
.phalanx-over { position: fixed; z-index: 10; transform: translateX(-50%); box-sizing: border-box;
  left: calc((100vw - var(--phx-plots, 0px) + 360px) / 2); width: max-content;
  max-width: max(100vw - var(--phx-plots, 0px) - 384px, 18em);
  font: 13px/1.5 system-ui, sans-serif; border-radius: 6px; }
@media (max-width: 1000px) { .phalanx-over { font-size: 11px; } }
@media (max-width: 576px) { .phalanx-over { left: 50vw; max-width: 94vw; } }
.phalanx-alarm { top: 12px; padding: 6px 12px; color: #fff; background: #e11d2e;
  box-shadow: 0 2px 12px #e11d2e88; font-weight: 600; }
.phalanx-alarm.phalanx-past { background: #92400e; box-shadow: none; font-weight: 400; }
.phalanx-legend { bottom: calc(var(--phx-timeline, 0px) + 10px); padding: 3px 12px;
  background: color-mix(in srgb, var(--mantine-color-body) 85%, transparent);
  color: var(--mantine-color-text); font-size: 12px; }
.phalanx-legend summary { cursor: pointer; font-weight: 600; }
.phalanx-legend div { display: flex; flex-wrap: wrap; gap: 0 1em; }
.phalanx-legend span { white-space: nowrap; }
@media (max-width: 1000px) { .phalanx-legend { font-size: 11px; line-height: 1.35; } }
@media (max-width: 576px) { .phalanx-legend { display: none; } }
</style>""")
"""Style of banner and legend, which are over the middle of the scene, between the panels."""


def banner(unsafe: list[str], past: list[str]) -> Markup:
    """A banner with lines about unsafe pairs, or about past ones; nothing without either."""
    shown, kind = (unsafe, "") if unsafe else (past, " phalanx-past")
    if not shown:
        return markup()
    left = len(shown) - _LINES
    more = [f"and {left} more pair{'s' * (left > 1)}"] if left > 0 else []
    lines = [element("div", line) for line in (*shown[:_LINES], *more)]
    return element("div", *lines, kind=f"phalanx-over phalanx-alarm{kind}", role="alert")


def legend() -> Markup:
    """Marks of the scene and their meanings, in an element that can be folded, and the style."""
    marks = [_mark("▲", COLOURS[role], role) for role in Role]
    marks += [
        _mark("◉", DANGER, "unsafe: h above 0"),
        _mark("◎", LIE, "sent a false broadcast"),
        _mark("∘", COLOURS[Role.NORMAL], "goal"),
        _mark("◯", (100, 116, 139), "circles touch where h = 0"),
        element("span", element("b", "◯"), " chosen agent"),
        _mark("—", WORST_PAIR, "worst pair"),
        _mark("—", LATE, "late link"),
        _mark("—", DANGER, "lost link"),
        element("span", element("b", "→"), " applied input"),
        _mark("→", (148, 163, 184), "nominal input"),
    ]
    summary = element("summary", "Legend")
    kind = "phalanx-over phalanx-legend"
    folding = element("details", summary, element("div", *marks), kind=kind, open="")
    return markup(_STYLE, folding)


def _mark(sign: str, colour: Colour, text: str) -> Markup:
    return element("span", element("b", sign, style=f"color:rgb{colour}"), f" {text}")
