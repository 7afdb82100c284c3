"""HTML pages that fetch nothing, and their parts. Every text is escaped here."""

import base64
import re
from collections.abc import Callable, Iterable, Sequence
from html import escape
from pathlib import Path
from string import Template

from matplotlib.figure import Figure

from phalanx.native.files import whole_file
from phalanx.report.style import svg_of

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
:root { --page: #fff; --text: #1d2127; --quiet: #5d6570; --line: #d9dde3; --stripe: #0001; }
@media (prefers-color-scheme: dark) {
  :root { --page: #16191d; --text: #e4e7eb; --quiet: #9aa3ae; --line: #353b43; --stripe: #fff1; }
}
body { background: var(--page); color: var(--text); font: 15px/1.5 system-ui, sans-serif;
  max-width: $width; margin: 1.2rem auto; padding: 0 1.2rem; overflow-wrap: break-word; }
h1 { font-size: 1.6rem; margin: 0; } h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem; }
p.quiet, figcaption, .none { color: var(--quiet); } p.quiet { margin: .2rem 0 1rem; }
nav { columns: 14rem; font-size: .9rem; } nav a { color: inherit; display: block; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .25rem .9rem .25rem .5rem; vertical-align: top;
  border-bottom: 1px solid var(--line); }
th + td:last-child { overflow-wrap: anywhere; } /* digests: there is room for words */
thead th { color: var(--quiet); } tbody tr:nth-child(even) { background: var(--stripe); }
/* A shadow at each edge behind which a table goes on; at its end the page's colour covers it. */
.wide { overflow: auto; max-height: 34rem; --shade: #7779, #0000; --to: var(--page) 40%, #0000;
  background: linear-gradient(90deg, var(--to)) 0 0/2rem 100% local no-repeat,
    linear-gradient(-90deg, var(--to)) 100% 0/2rem 100% local no-repeat,
    linear-gradient(0deg, var(--to)) 0 100%/100% 2rem local no-repeat,
    linear-gradient(90deg, var(--shade)) 0 0/.7rem 100% no-repeat,
    linear-gradient(-90deg, var(--shade)) 100% 0/.7rem 100% no-repeat,
    linear-gradient(0deg, var(--shade)) 0 100%/100% .7rem no-repeat; }
.verdict { border-left: .4rem solid var(--badge); background: var(--stripe); margin: 1.2rem 0;
  padding: .7rem 1rem; }
.verdict strong { background: var(--badge); color: #fff; border-radius: .3rem;
  letter-spacing: .04em; padding: .15rem .6rem; margin-right: .6rem; text-transform: uppercase;
  font-size: .85rem; }
.verdict p { margin: .4rem 0 0; }
.guaranteed { --badge: #1a7f46; } .safe { --badge: #a86a00; } .violated { --badge: #c1121f; }
.broken, .stopped, .unfinished { --badge: #5d6570; }
figure { margin: 1.2rem 0; } figcaption { font-size: .9rem; margin-top: .3rem; }
figure img { background: #fff; border: 1px solid var(--line); border-radius: .3rem;
  max-width: 100%; display: block; }
.verdict + figure img { max-height: 60vh; }
.drawn { overflow-x: auto; } .drawn img { background: none; border: 0; min-width: 38rem; }
.sortable td { max-width: 20rem; overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
.sortable td:hover { white-space: normal; }
.sortable td:last-child { font-family: monospace; max-width: none; user-select: all;
  white-space: nowrap; }
.sortable thead th { background: var(--page); position: sticky; top: 0; }
.sortable button { all: unset; cursor: pointer; white-space: nowrap; }
.sortable button:focus-visible { outline: 2px solid; }
.sortable [aria-sort=ascending] button::after { content: " ↑"; }
.sortable [aria-sort=descending] button::after { content: " ↓"; }
pre { background: var(--stripe); padding: .8rem; font-size: .8rem; white-space: pre-wrap; }
</style>
</head>
<body>
$body
</body>
</html>
""")


_SORT = """<script>
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0];
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.textContent = head.textContent;
    head.replaceChildren(button);
    button.onclick = () => {
      const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      heads.forEach(each => each.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
      const text = row => row.cells[column].textContent;
      const order = (a, b) => (a === "–") - (b === "–")
        || sign * (a - b || (isNaN(a - b) ? a.localeCompare(b) : 0));
      body.append(...[...body.rows].sort((a, b) => order(text(a), text(b))));
    };
  });
}
</script>"""


def save_page(
    path: Path, title: str, parts: Iterable[str], *, about: str = "", width: str = "72rem"
) -> Path:
    """Write a page of parts made here, its contents before the sections; return its path.

    about: a sentence below the title.
    """
    head = [f"<h1>{escape(title)}</h1>", *([quiet(about)] if about else [])]
    body = "\n".join([*head, *parts])
    links = re.findall(r'<section id="(.*?)"><h2>(.*?)</h2>', body)
    contents = "".join(f'<a href="#{name}">{text}</a>' for name, text in links)
    body = body.replace("<section", f"<nav>{contents}</nav>\n<section", 1)
    text = _PAGE.substitute(title=escape(title), body=body, width=width)
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")
    return path


def section(title: str, content: str) -> str:
    """A heading, and parts made here under it."""
    name = re.sub(r"\W+", "-", title)
    return f'<section id="{name}"><h2>{escape(title)}</h2>\n{content}</section>'


def table(
    head: Iterable[str], rows: Sequence[Sequence[str]], total: int | None = None,
    most: int = MOST_ROWS,
) -> str:  # fmt: skip
    """A table of the first rows, at most so many; total: their number, if only some are given."""
    if not rows:
        return note("None.")
    omitted = (total or len(rows)) - min(len(rows), most)
    titles = "".join(f'<th scope="col">{escape(title)}</th>' for title in head)
    top = f"<thead><tr>{titles}</tr></thead>" if titles else ""
    body = "\n".join(
        f'<tr><th scope="row">{escape(first)}</th>'
        + "".join(f"<td>{escape(cell)}</td>" for cell in rest)
        + "</tr>"
        for first, *rest in rows[:most]
    )
    element = f'<div class="wide" tabindex="0"><table>{top}<tbody>\n{body}\n</tbody></table></div>'
    return element + (note(f"and {omitted} more") if omitted else "")


def sortable(element: str) -> str:
    """A table with a head, made here, whose rows a click on a title sorts; the last on a page."""
    return element.replace("<table>", '<table class="sortable">', 1) + _SORT


def figure(caption: str, png: bytes) -> str:
    """A picture, embedded in the page, with its caption."""
    return _embedded("<figure>", "image/png", png, caption)


def drawing(caption: str, draw: Callable[[], Figure]) -> str:
    """A picture whose colours follow the page's, embedded in it, with its caption."""
    return _embedded('<figure class="drawn">', "image/svg+xml", svg_of(draw), caption)


def _embedded(start: str, kind: str, image: bytes, caption: str) -> str:
    data, caption = base64.b64encode(image).decode(), escape(caption)
    return (
        f'{start}<img alt="{caption}" src="data:{kind};base64,{data}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def note(text: str) -> str:
    """A paragraph about something that is missing."""
    return f'<p class="none">{escape(text)}</p>'


def quiet(text: str) -> str:
    """A paragraph in grey."""
    return f'<p class="quiet">{escape(text)}</p>'


def seconds(t: float | None) -> str:
    """A time [s] as text; None: never."""
    return "never" if t is None else f"{t:.3f} s"


def percent(part: int, whole: int) -> str:
    """A share as text; 0 of nothing."""
    return f"{100 * part / whole:.2f} %" if whole else "0 %"
