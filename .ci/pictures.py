"""Record which program made the pictures of docs/images, and name those of an older one.

    python .ci/pictures.py              # name stale pictures, and the commands that make them
    python .ci/pictures.py PICTURE...   # record that the present program made these

A picture is stale if its sources changed, or h_tot half a second into a scenario that it shows.
"""

import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parent.parent
IMAGES, RECORDS = Path("docs/images"), Path("evidence/pictures.json")
BY_HAND = {"architecture.svg"}
DIGITS = 6
"""Of h_tot: other computers round the rest in other ways."""


class Maker(NamedTuple):
    """A command that makes pictures."""

    command: str
    pictures: str
    """A pattern."""
    sources: tuple[str, ...]
    """Patterns of files: what draws, and data that are drawn."""
    scenarios: tuple[str, ...] = ()
    """Of the runs that are shown, without those whose worlds need more than Phalanx."""


REPORT = tuple(f"phalanx/report/{name}.py" for name in ("paths", "safety", "steps", "style"))
VIEWER = ("evidence/paper/viewer_pictures.py", *(f"viewer/phalanx_viewer/{f}/*.*" for f in
          ("page", "plots", "scene")))  # fmt: skip
LOOKS = "phalanx/report/style.py"


def of_report(scenario: str) -> Maker:
    command = "evidence/paper/pictures.py"
    return Maker(command, f"{scenario}.png", (command, *REPORT), (scenario,))


def of_viewer(pictures: str, scenario: str) -> Maker:
    return Maker(VIEWER[0], f"{pictures}.png", VIEWER, (scenario,))


MAKERS = (
    of_report("unicycles"),
    of_report("formation3d"),
    of_viewer("viewer", "unicycles"),
    of_viewer("viewer-narrow", "unicycles"),
    of_viewer("viewer-live*", "unicycles"),
    of_viewer("viewer-space*", "formation3d"),
    of_viewer("viewer-fence*", "fence"),
    of_viewer("viewer-alarm*", "surrounded"),
    of_viewer("viewer-swarm", "swarm"),
    of_viewer("viewer-radio*", "radio"),
    Maker(
        "evidence/network/faults_picture.py", "faults-*.png",
        ("evidence/network/faults_picture.py", "tests/network/pictured_faults.py", LOOKS),
        ("faults/lie-input",),
    ),
    Maker(
        "evidence/network/moving_picture.py", "radio.webp",
        ("evidence/network/moving_picture.py", "phalanx/report/animate.py", REPORT[0], LOOKS),
        ("radio", "radio-extrapolate"),
    ),
    Maker(
        "evidence/controllers/picture.py docs/images/controllers.png", "controllers.png",
        ("evidence/controllers/picture.py", "evidence/controllers/compare.py"),
        ("unicycles", "formation3d", "swarm2d", "faults/turn"),
    ),
    Maker(
        "evidence/paper/frontier.py", "frontier.png",
        ("evidence/paper/frontier.py", "evidence/paper/variants.py", LOOKS),
        ("guaranteed",),
    ),
    Maker(
        "evidence/unknown/hijacks_picture.py evidence/unknown/rows docs/images/hijacks.png",
        "hijacks.png",
        ("evidence/unknown/hijacks_picture.py", "evidence/unknown/verdicts.py",
         "evidence/unknown/rows/*/rows.parquet"),
    ),
    *(
        Maker(
            f"evidence/worlds/{name}.py --seeds 1 --picture docs/images/{name}.png",
            f"{name}.png",
            (f"evidence/worlds/{name}.py", "evidence/worlds/kept.py",
             f"scenarios/worlds/{name}.toml"),
        )
        for name in ("crazyflies", "rovers")
    ),
)  # fmt: skip


def maker_of(picture: str) -> Maker:
    """Return what makes a picture. Raises ValueError unless it is one command alone."""
    (maker,) = (each for each in MAKERS if Path(picture).match(each.pictures))
    return maker


def digest(maker: Maker, root: Path = ROOT) -> str:
    """Return a digest of the sources, and of the scenarios' files."""
    scenarios = [f"scenarios/{name}.toml" for name in maker.scenarios]
    found = hashlib.sha256()
    for pattern in (*maker.sources, *scenarios):
        files = sorted(root.glob(pattern))
        assert files, pattern
        for file in files:
            found.update(file.read_bytes())
    return found.hexdigest()


def h_tot(scenario: str) -> float:
    """Return h_tot half a second into a run."""
    import phalanx

    run = phalanx.run(phalanx.load(scenario, {"duration": 0.5}), engine="in-process")
    return float(f"{run.states['h_tot'][-1]:.{DIGITS}g}")


def records(root: Path = ROOT) -> dict[str, Any]:
    """Return by picture the digest of its sources and the h_tot; null of those known as stale."""
    return dict(json.loads((root / RECORDS).read_text("utf-8")))


def stale(root: Path = ROOT) -> Iterator[str]:
    """Yield the pictures whose sources are not known as those that they were made with."""
    for picture, record in records(root).items():
        if record is None or record["sources"] != digest(maker_of(picture), root):
            yield picture


def main(pictures: list[str]) -> None:
    if pictures:
        made = {}
        for picture in pictures:
            maker = maker_of(picture)
            values = {name: h_tot(name) for name in maker.scenarios}
            made[picture] = {"sources": digest(maker), "h_tot": values}
        text = json.dumps(records() | made, indent=2, sort_keys=True)
        (ROOT / RECORDS).write_text(text + "\n", "utf-8")
    for picture in stale():
        print(f"{picture}: python {maker_of(picture).command}")


if __name__ == "__main__":
    main(sys.argv[1:])
