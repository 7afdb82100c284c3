"""HTML pages that fetch nothing, and their parts. Every text is escaped here."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from string import Template

MOST_ROWS = 60
"""Most rows of a table."""

_PAGE = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>$title</title>
<style>
:root { --page: #fff; --text: #1d2127; --quiet: #5d6570; --line: #d9dde3; --stripe: #f5f6f8; }
@media (prefers-color-scheme: dark) {
  :root { --page: #16191d; --text: #e4e7eb; --quiet: #9aa3ae; --line: #353b43; --stripe: #1e2227; }
}
body { background: var(--page); color: var(--text); font: 15px/1.5 system-ui, sans-serif;
  max-width: $width; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.6rem; margin: 0; }
h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem; }
p.quiet, figcaption, .none { color: var(--quiet); }
p.quiet { margin: .2rem 0 1rem; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .25rem .9rem .25rem .5rem; vertical-align: top;
  border-bottom: 1px solid var(--line); overflow-wrap: anywhere; }
thead th { color: var(--quiet); font-weight: 600; }
tbody tr:nth-child(even) { background: var(--stripe); }
.wide { overflow: auto; max-height: 34rem; }
.verdict { border-left: .4rem solid var(--badge); background: var(--stripe); margin: 1.2rem 0;
  padding: .7rem 1rem; }
.verdict strong { background: var(--badge); color: #fff; border-radius: .3rem;
  letter-spacing: .04em; padding: .15rem .6rem; margin-right: .6rem; text-transform: uppercase;
  font-size: .85rem; }
.verdict p { margin: .4rem 0 0; overflow-wrap: anywhere; }
.guaranteed { --badge: #1a7f46; } .safe { --badge: #a86a00; } .violated { --badge: #c1121f; }
.broken, .stopped, .unfinished { --badge: #5d6570; }
figure { margin: 1.2rem 0; }
.side-by-side { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fit, minmax(24rem, 1fr)); }
figure img { background: #fff; border: 1px solid var(--line); border-radius: .3rem;
  max-width: 100%; display: block; }
figcaption { font-size: .9rem; margin-top: .3rem; }
pre { background: var(--stripe); padding: .8rem; overflow: auto; font-size: .8rem; }
</style>
</head>
<body>
$body
</body>
</html>
""")


def document(title: str, parts: Iterable[str], width: str) -> str:
    """A whole page, of parts made here; width is CSS."""
    return _PAGE.substitute(title=escape(title), body="\n".join(parts), width=width)


def section(title: str, content: str) -> str:
    """A heading, and parts made here under it."""
    return f"<h2>{escape(title)}</h2>\n{content}"


def table(head: Iterable[str], rows: Sequence[Sequence[str]], total: int | None = None) -> str:
    """A table of the first rows; total: number of rows, if only the worst are given."""
    if not rows:
        return note("None.")
    left = (total or len(rows)) - min(len(rows), MOST_ROWS)
    titles = "".join(f'<th scope="col">{escape(title)}</th>' for title in head)
    top = f"<thead><tr>{titles}</tr></thead>" if titles else ""
    body = "\n".join(
        f'<tr><th scope="row">{escape(first)}</th>'
        + "".join(f"<td>{escape(cell)}</td>" for cell in rest)
        + "</tr>"
        for first, *rest in rows[:MOST_ROWS]
    )
    shown = f'<div class="wide"><table>{top}<tbody>\n{body}\n</tbody></table></div>'
    return shown + (note(f"and {left} more") if left else "")


def figure(caption: str, png: bytes) -> str:
    """A picture, embedded in the page, with its caption."""
    data, caption = base64.b64encode(png).decode(), escape(caption)
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def note(text: str) -> str:
    """A paragraph about something that is missing."""
    return f'<p class="none">{escape(text)}</p>'


def seconds(t: float | None) -> str:
    """A time [s] as text; None: never."""
    return "never" if t is None else f"{t:.3f} s"


def milliseconds(seconds: float) -> str:
    """A time [s] as text, in ms."""
    return f"{1e3 * seconds:.4g} ms"


def percent(part: int, whole: int) -> str:
    """A share as text; 0 of nothing."""
    return f"{100 * part / whole:.2f} %" if whole else "0 %"
