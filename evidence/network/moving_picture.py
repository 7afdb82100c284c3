"""The moving picture of the README: eight robots by radio alone, and the better baseline.

python evidence/network/moving_picture.py
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path

from PIL import Image, ImageSequence

import phalanx

PICTURE = Path("docs/images/radio.webp")
SIDES = ("radio", "radio-extrapolate")
CHANGES = {"faults.0.at": 3.0, "duration": 15.0}
"""Of a partition from 1.5 s on this baseline knows enough; so does the other of one from 3 s on."""
SPEED, PER_SECOND, VERDICT = 2.0, 8, 2500
"""Virtual seconds in a second, frames in a second, and how long the last one is shown [ms]."""


def film(name: str, folder: Path) -> Path:
    """Run a scenario, print its verdict, and return its moving picture."""
    run = phalanx.run(phalanx.load(name, CHANGES), engine="in-process")
    print(name, run.verdict)
    return run.animate(folder / f"{name}.webp", speed=SPEED, per_second=PER_SECOND)


def side_by_side(left: Path, right: Path) -> Iterator[Image.Image]:
    """Yield each two frames of two moving pictures side by side."""
    with Image.open(left) as one, Image.open(right) as other:
        frames = zip(ImageSequence.Iterator(one), ImageSequence.Iterator(other), strict=True)
        for first, second in frames:
            whole = Image.new("RGB", (first.width + second.width, first.height), "white")
            whole.paste(first, (0, 0))
            whole.paste(second, (first.width, 0))
            yield whole.resize((whole.width * 2 // 3, whole.height * 2 // 3))


def main() -> None:
    """Run, draw, and print the verdicts and the picture's size."""
    with tempfile.TemporaryDirectory() as folder:
        first, *rest = side_by_side(*(film(name, Path(folder)) for name in SIDES))
    times = [round(1e3 / PER_SECOND)] * len(rest) + [VERDICT]
    first.save(
        PICTURE, save_all=True, append_images=rest, duration=times, loop=0, quality=50, method=4
    )  # fmt: skip
    print(f"{PICTURE.stat().st_size / 2**20:.2f} MiB")


if __name__ == "__main__":
    main()
