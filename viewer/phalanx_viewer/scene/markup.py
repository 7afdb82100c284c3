"""HTML of the page. What is no markup yet is text, and stays text: a recording's is anybody's."""

from html import escape

import viser


class Markup(str):
    """HTML that was made here; any other string is text."""

    __slots__ = ()


def markup(*parts: str) -> Markup:
    """Parts one after another, texts among them escaped."""
    return Markup("".join(p if isinstance(p, Markup) else escape(p) for p in parts))


def element(tag: str, *parts: str, kind: str = "", **attributes: str) -> Markup:
    """An HTML element around parts; kind: its class."""
    named = {"class": kind} if kind else {}
    told = "".join(f' {name}="{escape(value)}"' for name, value in (named | attributes).items())
    return Markup(f"<{tag}{told}>{markup(*parts)}</{tag}>")


class Panel:
    """A place of the page that holds markup."""

    def __init__(self, gui: viser.GuiApi, content: Markup, order: float | None = None) -> None:
        self._html = gui.add_html(str(content), order=order)

    def show(self, content: Markup) -> None:
        """Hold this from now on."""
        if content != self._html.content:
            self._html.content = str(content)  # plain: viser sends no other strings
