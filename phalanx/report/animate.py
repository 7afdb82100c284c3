"""A run as a moving picture: its file, and the times of its frames."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from phalanx.recording.read import Recording
from phalanx.report.history import ReportHistory
from phalanx.report.stage import RESOLUTION, Film, Stage

FORMATS = (".gif", ".webp", ".mp4")
_UNITS = {".gif": 10, ".webp": 1}
"""In what the format counts time [ms]."""
_COLOURS = 128
_VERDICT = 2.5
"""How long the last frame is shown [s]."""


def animate(recording: Recording, path: Path, speed: float = 1.0, per_second: int = 15) -> Path:
    """Write a recording as a moving picture; its name's ending is one of FORMATS.

    Args:
        recording: of the run.
        path: of the picture.
        speed: virtual seconds in a second.
        per_second: frames.

    Returns the path.

    Raises:
        ValueError: there is no such format, .mp4 lacks ffmpeg, or there is nothing to draw.
        OSError: it cannot be written.
    """
    _require(recording, path, speed, per_second)
    history = ReportHistory(recording)
    count = max(int(history.times[-1] / speed * per_second), 1)
    film = Film(np.linspace(0.0, history.times[-1], count + 1), per_second, speed)
    stage = Stage(history, film)
    write = _write_video if path.suffix == ".mp4" else _write_image
    write(stage, path)
    return path


def _require(recording: Recording, path: Path, speed: float, per_second: int) -> None:
    if path.suffix not in FORMATS:
        raise ValueError(f"path: expected a name that ends in {', '.join(FORMATS)}, got {path}")
    if path.suffix == ".mp4" and not shutil.which("ffmpeg"):
        raise ValueError("path: .mp4 needs the program ffmpeg: install it, or write .webp or .gif")
    if not (speed > 0.0 and 1 <= per_second <= 60):
        raise ValueError(
            f"speed and per_second: expected above 0, and 1 to 60, got {speed} and {per_second}"
        )
    if not recording.states:
        raise ValueError(f"{recording.path}: the recording holds no state: nothing to draw")


def _write_video(stage: Stage, path: Path) -> None:
    looks = ["-pix_fmt", "yuv420p"]  # what every player can show
    writer = FFMpegWriter(fps=stage.film.per_second, codec="h264", extra_args=looks)
    with writer.saving(stage.figure, str(path), RESOLUTION):
        for _ in stage.frames():
            writer.grab_frame()
        for _ in range(int(_VERDICT * stage.film.per_second)):
            writer.grab_frame()


def _write_image(stage: Stage, path: Path) -> None:
    canvas = FigureCanvasAgg(stage.figure)

    def drawn() -> Image.Image:
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])

    # One palette with its white, and no dithering: half the size, and the ground does not flicker.
    stage.show(len(stage.film.times) - 1)
    palette = drawn().quantize(_COLOURS, method=Image.Quantize.MAXCOVERAGE)
    # Each at once, since a picture of all colours takes three times the memory.
    first, *rest = [
        drawn().quantize(palette=palette, dither=Image.Dither.NONE) for _ in stage.frames()
    ]
    # The ends of frames are rounded, not their lengths, which would change the speed.
    unit = _UNITS[path.suffix]
    ends = np.round(np.arange(len(rest) + 1) * 1e3 / stage.film.per_second / unit) * unit
    duration = [*np.diff(ends).astype(int).tolist(), round(1e3 * _VERDICT)]
    lossless: dict[str, Any] = {"lossless": True, "method": 1, "quality": 30}
    looks = lossless if path.suffix == ".webp" else {}
    first.save(path, save_all=True, append_images=rest, duration=duration, loop=0, **looks)
