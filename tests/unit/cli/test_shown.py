"""Commands that help texts and pages show: their scenarios can be loaded as they are written."""

import re
import shlex
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from phalanx.scenario.load import load, shipped

ROOT = Path(__file__).parents[3]
PLACES = [ROOT / "README.md", *ROOT.glob("docs/**/*.md"), *ROOT.glob("phalanx/cli/*.py")]
COMMAND = re.compile(r"^\s*(phalanx (?:run|check) [^#\n]*)", re.MULTILINE)


def commands() -> Iterator[str]:
    """Every command shown that names a scenario which ships."""
    for path in PLACES:
        for text in COMMAND.findall(path.read_text(encoding="utf-8")):
            if text.split()[2] in shipped():
                yield re.sub(r"\[.*?\]", "", text).strip()


@pytest.mark.parametrize("command", sorted(set(commands())))
def test_its_scenario_can_be_loaded(command):
    _, _, scenario, *options = shlex.split(command)
    overrides = [value for name, value in pairwise(options) if name == "--set"]
    seed = options[options.index("--seed") + 1] if "--seed" in options else None
    assert load(scenario, overrides, seed and int(seed)).agents
