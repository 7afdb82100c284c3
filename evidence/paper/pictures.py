"""The pictures of README.md and docs, from runs of the scenarios that ship.

python evidence/paper/pictures.py
"""

from pathlib import Path

from PIL import Image

import phalanx

IMAGES = Path("docs/images")


PICTURES = {
    "unicycles": ("paths.png", "h_tot.png"),
    "formation3d": ("paths.png", "h_tot.png", "inputs-2.png"),
}
"""Figures of the report by scenario."""


def main() -> None:
    """Run each scenario once and save its picture."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    for name, figures in PICTURES.items():
        run = phalanx.run(name, engine="in-process")
        folder = run.report().parent / "figures"
        pictures = above_each_other([folder / figure for figure in figures])
        pictures.save(IMAGES / f"{name}.png", optimize=True)


def above_each_other(files: list[Path]) -> Image.Image:
    """Pictures in one column, on white."""
    pictures = [Image.open(file).convert("RGB") for file in files]
    width, height = max(p.width for p in pictures), sum(p.height for p in pictures)
    page = Image.new("RGB", (width, height), "white")
    top = 0
    for picture in pictures:
        page.paste(picture, (0, top))
        top += picture.height
    return page


if __name__ == "__main__":
    main()
