"""Texts: HTML of the page, the banner over the scene, and labels in it."""

from collections.abc import Sequence
from html import escape
from itertools import product

import numpy as np
import viser

from phalanx.theory.arrays import Array
from phalanx_viewer.scene.agents import lines
from phalanx_viewer.scene.cameras import View
from phalanx_viewer.scene.colours import OBSTACLE, WORST_PAIR
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.nodes import linear, single, update
from phalanx_viewer.scene.picture import Picture


class Markup(str):
    """HTML that was made here; any other string is text, to be escaped."""

    __slots__ = ()


_NODES = 24
"""Most labels at a time: each is a node of its own."""
_PAIR = -1
"""The worst pair's key among agents."""
LETTER, _LINE, _LEGEND = 0.013, 0.032, -0.35
"""Width of a letter, height of a line, and of the legend's edge over the picture's middle, in the
shorter side of a usual picture."""
_FAR = 8
"""Positions of a name that a line leads to, where there is no room next to its agent."""
_LINES = 3
"""Most pairs that the banner names; all are in the event log."""


def markup(*parts: str) -> Markup:
    """Join parts; those that are text are escaped."""
    return Markup("".join(p if isinstance(p, Markup) else escape(p) for p in parts))


def element(tag: str, *parts: str, kind: str = "", **attributes: str) -> Markup:
    """An HTML element around parts; kind: its class."""
    attributes = ({"class": kind} if kind else {}) | attributes
    texts = [f' {name}="{escape(value)}"' for name, value in attributes.items()]
    return Markup(f"<{tag}{''.join(texts)}>{markup(*parts)}</{tag}>")


class Panel:
    """A part of the page that holds markup."""

    def __init__(self, gui: viser.GuiApi, content: Markup, order: float | None = None) -> None:
        self._html = gui.add_html(str(content), order=order)

    def show(self, content: Markup) -> None:
        if content != self._html.content:
            self._html.content = str(content)  # plain: viser sends no other strings


def banner(unsafe: list[str], past: list[str]) -> Markup:
    """A banner with lines about unsafe pairs, or about past ones; nothing without either."""
    text, kind = (unsafe, "") if unsafe else (past, " phalanx-past")
    if not text:
        return markup()
    rest = len(text) - _LINES
    more = [f"and {rest} more pair{'s' * (rest > 1)}"] if rest > 0 else []
    lines = [element("div", line) for line in (*text[:_LINES], *more)]
    return element("div", *lines, kind=f"phalanx-over phalanx-alarm{kind}", role="alert")


class LabelNodes:
    """Texts by importance: unsafe agents, the chosen one, the worst pair, the others.

    Names of the first two are placed wherever there is room around their agents, others above or
    below; where there is none, farther away, and a line leads there. One also leads from the worst
    pair to its text.
    """

    def __init__(self, scene: viser.SceneApi, model: SceneModel) -> None:
        self._model = model
        self._nodes = [
            scene.add_label(f"/labels/{k}", "", anchor="center-center", visible=False)
            for k in range(min(_NODES, len(model.names)) + 1)
        ]
        # viser draws new letters over some pictures, and in these shows old texts at new places.
        pairs = range(len(model.swarm.safe_set.pairs))
        letters = set("0123456789.:,-+=ehm").union(*map(model.label, pairs))
        scene.add_label("/labels/letters", "".join(sorted(letters)), visible=False)
        self._leader = lines(scene, "/leader", np.tile(WORST_PAIR, (1, 2, 1)), 1.0)

    def show(self, picture: Picture, selected: int | None, sizes: Array, view: View) -> None:
        """Show the texts that there is room for; sizes of the bodies [m], shape (N,)."""
        agents, texts, candidates = self._candidates(picture, selected, sizes, view)
        on_page = [view.project(points) / view.enlargement for points in candidates]
        middles = view.project(picture.positions) / view.enlargement
        halves = sizes / view.spans(picture.positions) / view.enlargement
        bodies = [] if self._model.crowded else np.column_stack([middles, halves]).tolist()
        choices = place_texts(on_page, [*map(len, texts)], bodies)[: len(self._nodes)]
        for node, (k, choice) in zip(self._nodes, choices, strict=False):
            update(node, text=texts[k], visible=True)
            node.position = tuple(candidates[k][choice])
        for node in self._nodes[len(choices) :]:
            node.visible = False
        ends, colours = [], []
        for k, choice in choices:
            of_pair, begin = agents[k] == _PAIR, picture.positions[max(agents[k], 0)]
            if of_pair or choice >= len(candidates[k]) - _FAR:
                begin = np.mean(picture.worst_pair, axis=0) if of_pair else begin
                ends.append([begin, candidates[k][choice]])
                colours.append([WORST_PAIR if of_pair else OBSTACLE] * 2)
        self._leader.visible = bool(ends)
        if ends:
            points, of_ends = single(np.array(ends)), linear(np.array(colours))
            update(self._leader, points=points, colors=of_ends)

    def _candidates(
        self, picture: Picture, selected: int | None, sizes: Array, view: View
    ) -> tuple[list[int], list[str], list[Array]]:
        """Agents (or _PAIR) by importance, their texts, and positions of each, shapes (c, 3)."""
        model = self._model
        chosen = [] if selected is None else [selected]
        first = list(dict.fromkeys([*np.flatnonzero(picture.unsafe_agents).tolist(), *chosen]))
        others = [] if model.crowded else range(len(model.names))
        later = dict.fromkeys([*sorted(model.agents_of([picture.pair])), *others])
        agents = [*first, _PAIR, *(i for i in later if i not in first)]
        texts = [picture.worst_pair_text if i == _PAIR else model.names[i] for i in agents]
        clear_of = 1.5 * float(sizes[sorted(model.agents_of([picture.pair]))].max())
        letters = len(picture.worst_pair_text)
        at_pair = text_places(*picture.worst_pair, letters, clear_of, view)
        around = [
            at_pair if i == _PAIR else self._around(picture, i, sizes[i], view, i in first)
            for i in agents
        ]
        return agents, texts, around

    def _around(self, picture: Picture, i: int, size: float, view: View, first: bool) -> Array:
        """Positions for an agent's name: next to it, the last _FAR farther away, shape (c, 3)."""
        at, (right, up, _) = picture.positions[i], view.axes
        letter = view.enlargement * float(view.spans(at[None])[0])
        middles = []
        for clear in (1.1 * size, 3.3 * size):
            high = (clear + 0.5 * _LINE * letter) * up
            wide = (clear + 0.5 * LETTER * (len(self._model.names[i]) + 1.0) * letter) * right
            middles += [at + high, at - high, at + wide, at - wide]
            middles += [at + high + wide, at + high - wide, at + wide - high, at - high - wide]
        return np.array(middles if first else middles[:2] + middles[_FAR:])


def text_places(a: Array, b: Array, letters: int, clear: float, view: View) -> Array:
    """Middles of a text below and above the line from a to b, `clear` off it [m], shape (2, 3)."""
    # A limit has no position of its own: its text is below the agent.
    right, up = view.axes[:2] @ (b - a) if a is not b else (1.0, 0.0)
    # Square to the line in the picture, and downwards rather than up.
    off = np.array([up, -right]) / max(float(np.hypot(right, up)), 1e-9)
    off = -off if off[1] > 0.0 else off
    middle = (a + b) / 2.0
    span = float(view.spans(middle[None])[0])
    halves = view.enlargement * span * np.array([LETTER * letters, _LINE]) / 2.0
    away = (clear + np.abs(off) @ halves) * off @ view.axes[:2]
    both: Array = middle + np.array([away, -away])
    # Next to a pair at the picture's edge they would be cut off, or under the legend.
    (x, y), edge = view.project(both).T, max(1.0, view.aspect) / 2.0
    inside = max(edge - halves[0] / span, 0.0)
    both += span * np.outer(np.clip(x, -inside, inside) - x, view.axes[0])
    return both if y[0] > _LEGEND else both[::-1]


def place_texts(
    candidates: Sequence[Array], letters: Sequence[int], bodies: Sequence[Sequence[float]] = ()
) -> list[tuple[int, int]]:
    """Choose texts that do not overlap, and their positions, by index; the first have priority.

    A text covers no body either, if it has a position that is free of both.

    candidates: positions for each in a usual picture, in its shorter sides, shapes (c, 2).
    letters: length of each. bodies: middle and half the width of each.
    """
    choices: list[tuple[int, int]] = []
    areas: list[Sequence[float]] = []
    for k, (positions, count) in enumerate(zip(candidates, letters, strict=True)):
        half = LETTER * (count + 1.0) / 2.0
        for taken, (choice, (x, y)) in product(
            ([*areas, *bodies], areas), enumerate(positions.tolist())
        ):
            if all(abs(x - a) >= half + wide or abs(y - b) >= _LINE for a, b, wide in taken):
                choices.append((k, choice))
                areas = [*areas, (x, y, half)]
                break
    return choices
