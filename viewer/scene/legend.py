"""What the scene's colours and lines mean: a legend that is open, and folds."""

from phalanx.viewer.scene.banner import OVER_THE_SCENE
from phalanx.viewer.scene.palette import DANGER, LATE, WORST_PAIR, Colour
from phalanx.viewer.scene.roles import COLOURS, Role

_STYLE = """<style>
.phalanx-legend { bottom: calc(var(--phx-timeline, 0px) + 10px); padding: 3px 12px;
  background: color-mix(in srgb, var(--mantine-color-body) 85%, transparent);
  color: var(--mantine-color-text); font-size: 12px; }
.phalanx-legend summary { cursor: pointer; font-weight: 600; }
.phalanx-legend div { display: flex; flex-wrap: wrap; gap: 0 1em; }
.phalanx-legend span { white-space: nowrap; }
@media (max-width: 1000px) { .phalanx-legend { font-size: 11px; line-height: 1.35; } }
@media (max-width: 576px) { .phalanx-legend { display: none; } }
</style>"""


def legend() -> str:
    """As HTML."""
    marks = [_mark("&#9650;", COLOURS[role], role) for role in Role]
    marks += [
        _mark("&#9673;", DANGER, "unsafe: h above 0"),
        _mark("&#9711;", (100, 116, 139), "circles touch where h = 0"),
        _mark("&#8212;", WORST_PAIR, "worst pair"),
        _mark("&#8212;", LATE, "late link"),
        _mark("&#8212;", DANGER, "lost link"),
        "<span><b>&#8594;</b> applied input</span>",
        _mark("&#8594;", (148, 163, 184), "nominal input"),
    ]
    return (
        f'{OVER_THE_SCENE}{_STYLE}<details open class="phalanx-over phalanx-legend">'
        f"<summary>Legend</summary><div>{''.join(marks)}</div></details>"
    )


def _mark(sign: str, colour: Colour, text: str) -> str:
    return f'<span><b style="color:rgb{colour}">{sign}</b> {text}</span>'
