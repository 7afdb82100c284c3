"""The banner over the scene while a pair is unsafe, and what is left of it afterwards."""

import viser

from phalanx_viewer.scene.markup import Markup, Panel, element, markup
from phalanx_viewer.scene.picture import Picture

_LINES = 3
"""Most pairs that the banner names; all are in the event log."""
OVER_THE_SCENE = Markup("""<style>
.phalanx-over { position: fixed; z-index: 10; transform: translateX(-50%); box-sizing: border-box;
  left: calc((100vw - var(--phx-plots, 0px) + 360px) / 2); width: max-content;
  max-width: max(100vw - var(--phx-plots, 0px) - 384px, 18em);
  font: 13px/1.5 system-ui, sans-serif; border-radius: 6px; }
@media (max-width: 1000px) { .phalanx-over { font-size: 11px; } }
@media (max-width: 576px) { .phalanx-over { left: 50vw; max-width: 94vw; } }
</style>""")
"""Style of what lies over the middle of the scene, between the panels."""
_STYLE = Markup("""<style>
.phalanx-alarm { top: 12px; padding: 6px 12px; color: #fff; background: #e11d2e;
  box-shadow: 0 2px 12px #e11d2e88; font-weight: 600; }
.phalanx-alarm.phalanx-past { background: #92400e; box-shadow: none; font-weight: 400; }
</style>""")


class Banner:
    """Says who is unsafe, how deep and since when."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._panel = Panel(gui, markup(), order=-1.0)

    def show(self, picture: Picture) -> None:
        """Sound the alarm, or take it back."""
        self._panel.show(banner(picture.alarms, picture.past_alarms))


def banner(alarms: list[str], past: list[str]) -> Markup:
    """What it says; nothing while nothing ever happened."""
    told, kind = (alarms, "") if alarms else (past, " phalanx-past")
    if not told:
        return markup()
    left = len(told) - _LINES
    more = [f"and {left} more pair{'s' * (left > 1)}"] if left > 0 else []
    lines = [element("div", line) for line in (*told[:_LINES], *more)]
    content = element("div", *lines, kind=f"phalanx-over phalanx-alarm{kind}", role="alert")
    return markup(OVER_THE_SCENE, _STYLE, content)
