"""Tables as HTML, for the values that a notebook shows."""

from collections.abc import Iterable, Sequence
from html import escape

_LEFT = " style='text-align:left'"


def html_table(rows: Iterable[Sequence[str]], head: Sequence[str] = ()) -> str:
    """Return rows as a table; the first cell of each names it. Texts are escaped."""
    titles = "".join(f"<th{_LEFT}>{escape(title)}</th>" for title in head)
    top = f"<tr>{titles}</tr>" if titles else ""
    body = "".join(
        f"<tr><th{_LEFT}>{escape(name)}</th>"
        + "".join(f"<td{_LEFT}>{escape(cell)}</td>" for cell in cells)
        + "</tr>"
        for name, *cells in rows
    )
    return f"<table>{top}{body}</table>"
