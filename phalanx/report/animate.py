"""A run as a moving picture: agents, their links, words, and the time in h_tot."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from phalanx.faults.commands import Condition
from phalanx.guarantee.verdict import Outcome
from phalanx.native.files import whole_file
from phalanx.recording.curves.history import (
    EMPTY_CODES,
    FATES,
    LOST,
    RecordedHistory,
    ReportHistory,
)
from phalanx.recording.read import Recording
from phalanx.report.paths import draw_scene, scene_box
from phalanx.report.safety import draw_h, required_distance
from phalanx.report.style import LIMIT, NORMAL, PEAK, colours, summarises
from phalanx.theory.arrays import Array

_UNITS = {".gif": 10, ".webp": 1}
"""In what each format counts time [ms]."""
_COLOURS = 128
_VERDICT = 2.5
"""How long the last frame is shown [s]."""
_RESOLUTION = 100
"""[pixels per inch]"""
_WIDTH, _STRIP = 7.2, 1.4
"""Of the picture, and height of the panel of h_tot [inch]."""
_TRAIL, _NOTICE = 2.5, 2.0
"""How long a trail and a line of the event log are shown [s of film]."""
_ADVERSARY, _SILENT, _EMPTY = "#d62728", "#9aa0a8", "#f97316"
_DELIVERED, _LOST = "#7f9cc4", "#d62728"
_OF_OUTCOME = {Outcome.GUARANTEED: "#1c8a4a", Outcome.SAFE: NORMAL}

Show = Callable[[int], None]
"""Shows a frame, by its number."""


def animate(recording: Recording, path: Path, speed: float = 1.0, per_second: int = 15) -> Path:
    """Write a recording as a moving picture, as Run.animate says."""
    if path.suffix not in _UNITS:
        raise ValueError(f"path: expected a name that ends in {', '.join(_UNITS)}, got {path}")
    if not (speed > 0.0 and 1 <= per_second <= 60):
        raise ValueError(
            f"speed and per_second: expected above 0, and 1 to 60, got {speed} and {per_second}"
        )
    if not recording.states:
        raise ValueError(f"{recording.path}: the recording holds no state: nothing to draw")
    history = ReportHistory(recording)
    count = max(int(history.times[-1] / speed * per_second), 1)
    stage = Stage(history, Film(np.linspace(0.0, history.times[-1], count + 1), per_second, speed))
    with whole_file(path) as part:
        _write_image(stage, part)
    return path


class Film(NamedTuple):
    """The frames of a moving picture."""

    times: Array
    """Virtual time of each [s]."""
    per_second: int
    speed: float
    """Virtual seconds in a second."""


class Stage:
    """The figure, and all that moves on it."""

    def __init__(self, history: ReportHistory, film: Film) -> None:
        """Draw what does not move: obstacles, and h_tot."""
        self.film = film
        low, high = scene_box(history)
        tall = min(max((_WIDTH - 1.0) * (high[1] - low[1]) / (high[0] - low[0]), 2.5), 6.0)
        size = _WIDTH, tall + _STRIP + 0.9
        self.figure = Figure(size, _RESOLUTION, layout="constrained", facecolor="white")
        arena, strip = self.figure.subplots(2, 1, height_ratios=[tall, _STRIP])
        draw_scene(arena, history, (0, 1))
        points = _positions(history, film.times)
        self._shows = [
            _links(arena, history, film, points),
            _agents(arena, history, film, points),
            _words(arena, history, film),
            _progress(strip, history, film),
        ]
        self.show(0)
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")  # to lay out a frame takes as long as to draw it

    def show(self, number: int) -> None:
        """Show a frame, by its number; the last one has the verdict."""
        for show in self._shows:
            show(number)

    def frames(self) -> Iterator[int]:
        """Show each frame, and yield its number."""
        for number in range(len(self.film.times)):
            self.show(number)
            yield number


def _write_image(stage: Stage, part: Path) -> None:
    canvas = FigureCanvasAgg(stage.figure)

    def picture() -> Image.Image:
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])

    # One palette with its white, and no dithering: half the size, and the ground does not flicker.
    stage.show(len(stage.film.times) - 1)
    palette = picture().quantize(_COLOURS, method=Image.Quantize.MAXCOVERAGE)
    # Each at once, since a picture of all colours takes three times the memory.
    first, *rest = [
        picture().quantize(palette=palette, dither=Image.Dither.NONE) for _ in stage.frames()
    ]
    # The ends of frames are rounded, not their lengths, which would change the speed.
    unit = _UNITS[part.suffix]
    ends = np.round(np.arange(len(rest) + 1) * 1e3 / stage.film.per_second / unit) * unit
    duration = [*np.diff(ends).astype(int).tolist(), round(1e3 * _VERDICT)]
    lossless: dict[str, Any] = {"lossless": True, "method": 1, "quality": 30}
    looks = lossless if part.suffix == ".webp" else {}
    first.save(part, save_all=True, append_images=rest, duration=duration, loop=0, **looks)


def _positions(history: RecordedHistory, times: Array) -> Array:
    """Output points from above at these times [m], shape (f, N, 2), between states on a line."""
    p = history.positions[:, :, :2]
    flat = p.reshape(len(p), -1).T
    return np.array([np.interp(times, history.times, c) for c in flat]).T.reshape(-1, *p.shape[1:])


def _links(axes: Axes, history: RecordedHistory, film: Film, points: Array) -> Show:
    """Draw links with broadcasts since the last frame: the more red, the more were lost."""
    lines = LineCollection([], linewidths=1.1, zorder=1.5)
    axes.add_collection(lines)
    every = np.sort(history.broadcasts, order="sent")
    ends = np.searchsorted(every["sent"], film.times, side="right")

    def show(number: int) -> None:
        broadcasts = every[ends[number - 1] if number else 0 : ends[number]]
        sides = np.sort(np.column_stack([broadcasts["sender"], broadcasts["receiver"]]), axis=1)
        links, link_of = np.unique(sides, axis=0, return_inverse=True)
        lost = np.bincount(link_of.ravel(), broadcasts["fate"] == FATES.index(LOST), len(links))
        share = (lost / np.bincount(link_of.ravel(), minlength=len(links)))[:, None]
        shade = share * to_rgb(_LOST) + (1.0 - share) * to_rgb(_DELIVERED)
        lines.set_segments(list(points[number][links]))
        lines.set_color(np.column_stack([shade, 0.4 + 0.6 * share]))

    return show


def _agents(axes: Axes, history: RecordedHistory, film: Film, points: Array) -> Show:
    """Draw agents as discs of half the required distance, with trails; orange: K_i was empty."""
    scenario, count = history.scenario, points.shape[1]
    many = summarises(scenario)
    palette = colours(scenario)
    roster = list(scenario.roster())
    roles = [NORMAL if group.role == "normal" else _ADVERSARY for _, group, _ in roster]
    agent_colours = roles if many else [palette[name] for name, _, _ in roster]
    size = np.full(count, required_distance(scenario) or 0.4)
    discs = EllipseCollection(
        size, size, np.zeros(count), units="xy", offsets=points[0],
        offset_transform=axes.transData, linewidths=1.2, zorder=3,
    )  # fmt: skip
    axes.add_collection(discs)
    trails = LineCollection([], colors=agent_colours, linewidths=1.2, alpha=0.6)
    axes.add_collection(trails)
    names = [
        axes.annotate(name, p, ha="center", va="center", fontsize=8, color=LIMIT, zorder=4)
        for (name, _, _), p in zip(roster, points[0], strict=True)
        if not many
    ]
    empty = _empty_frames(history, film)
    trail_length = max(int(_TRAIL * film.per_second), 1)

    def looks(i: int, condition: Condition) -> str:
        turned = condition is Condition.TURNED
        return _SILENT if condition.silent else _ADVERSARY if turned else agent_colours[i]

    def show(number: int) -> None:
        conditions = {c.agent: c.condition for c in history.conditions if c.t <= film.times[number]}
        colour = [looks(i, conditions.get(i, Condition.FINE)) for i in range(count)]
        discs.set_offsets(points[number])
        discs.set_facecolor([(*to_rgb(c), 0.3) for c in colour])
        discs.set_edgecolor([_EMPTY if empty[number, i] else colour[i] for i in range(count)])
        trails.set_segments(list(points[max(number - trail_length, 0) : number + 1].swapaxes(0, 1)))
        for text, p in zip(names, points[number], strict=False):
            text.set_position(p)

    return show


def _empty_frames(history: RecordedHistory, film: Film) -> Array:
    """Steps with an empty K_i since the last frame, as a mask of agents, shape (f, N)."""
    mask = np.zeros((len(film.times), len(history.swarm.names)), dtype=bool)
    for i in history.swarm.normal:
        steps = history.agent(i)
        at = np.searchsorted(film.times, steps.t[np.isin(steps.empty, list(EMPTY_CODES.values()))])
        mask[at[at < len(mask)], i] = True
    return mask


def _words(axes: Axes, history: ReportHistory, film: Film) -> Show:
    """Write the time, the share of broadcasts lost, what the event log says, and the verdict."""
    summary, name = history.recording.summary, history.scenario.name
    clock = axes.set_title("", loc="left", fontsize=11)
    network = axes.set_title("", loc="right", fontsize=9, color=LIMIT)
    at: dict[str, Any] = {"transform": axes.transAxes, "zorder": 5}
    # A recorded text may hold what matplotlib would take for a formula.
    log = axes.text(0.015, 0.98, "", va="top", fontsize=9, color=PEAK, parse_math=False, **at)
    card = {"boxstyle": "round,pad=0.5", "facecolor": "white", "edgecolor": LIMIT, "alpha": 0.92}
    end = axes.text(0.5, 0.1, "", ha="center", va="center", fontsize=15, weight="bold", **at)
    if summary:
        end.set_color(_OF_OUTCOME.get(summary.outcome, PEAK))
        end.set_bbox(card)
    every = history.broadcasts
    all_times = np.sort(every.sent)
    loss_times = np.sort(every.sent[every.fate == FATES.index(LOST)])

    def show(number: int) -> None:
        t = film.times[number]
        clock.set_text(f"{name}, t = {t:.1f} s")
        total, lost = np.searchsorted(all_times, t), np.searchsorted(loss_times, t)
        network.set_text(f"{total} broadcasts, {lost / total:.0%} lost" if total else "")
        since = t - _NOTICE * film.speed
        new = [line for line in history.recording.log if since < line.t <= t]
        log.set_text("\n".join(f"{line.t:.1f} s: {line.text}" for line in new[-3:]))
        end.set_text(str(summary.outcome) if summary and number == len(film.times) - 1 else "")

    return show


def _progress(axes: Axes, history: ReportHistory, film: Film) -> Show:
    """Draw h, and a veil over what is still to come."""
    draw_h(axes, history)
    veil = Rectangle((0.0, 0.0), 1.0, 1.0, facecolor="white", alpha=0.8, zorder=3)
    veil.set_transform(axes.get_xaxis_transform())
    axes.add_patch(veil)
    last = axes.get_xlim()[1]

    def show(number: int) -> None:
        veil.set_x(film.times[number])
        veil.set_width(last - film.times[number])

    return show
