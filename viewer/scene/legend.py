"""What the scene's colours and lines mean: a legend that is open, and folds."""

from phalanx.viewer.scene.banner import OVER_THE_SCENE
from phalanx.viewer.scene.markup import Markup, element, markup
from phalanx.viewer.scene.palette import DANGER, LATE, LIE, WORST_PAIR, Colour
from phalanx.viewer.scene.roles import COLOURS, Role

_STYLE = Markup("""<style>
.phalanx-legend { bottom: calc(var(--phx-timeline, 0px) + 10px); padding: 3px 12px;
  background: color-mix(in srgb, var(--mantine-color-body) 85%, transparent);
  color: var(--mantine-color-text); font-size: 12px; }
.phalanx-legend summary { cursor: pointer; font-weight: 600; }
.phalanx-legend div { display: flex; flex-wrap: wrap; gap: 0 1em; }
.phalanx-legend span { white-space: nowrap; }
@media (max-width: 1000px) { .phalanx-legend { font-size: 11px; line-height: 1.35; } }
@media (max-width: 576px) { .phalanx-legend { display: none; } }
</style>""")


def legend() -> Markup:
    """As it is on the page."""
    marks = [_mark("▲", COLOURS[role], role) for role in Role]
    marks += [
        _mark("◉", DANGER, "unsafe: h above 0"),
        _mark("◎", LIE, "told something false"),
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
    told = element("details", summary, element("div", *marks), kind=kind, open="")
    return markup(OVER_THE_SCENE, _STYLE, told)


def _mark(sign: str, colour: Colour, text: str) -> Markup:
    return element("span", element("b", sign, style=f"color:rgb{colour}"), f" {text}")
