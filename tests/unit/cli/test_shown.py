"""Commands that pages and help texts show are taken by the command line as they are written."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from typer.main import get_command

from phalanx.cli.app import extended, status
from phalanx.cli.option_checks import refuse_secrets, require_values
from phalanx.cli.options import with_factor
from phalanx.scenario.load import load, shipped

ROOT = Path(__file__).parents[3]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *ROOT.glob("evidence/*/*.md")]
SOURCES = [
    *(ROOT / "phalanx").rglob("*.py"),
    *(ROOT / "viewer").rglob("*.py"),
    *ROOT.glob("packages/*/phalanx_*/*.py"),
]
HISTORY = {"CHANGELOG.md", "retired.md"}
OF_EXAMPLES = {"closest"}
"""Commands of packages that a page tells to write."""
A_USERS = re.compile(r"my-scenario|smallest|found/|attacks/guaranteed/found/|studies/")
"""Files that a user writes, or a command shown before."""
COMMAND = re.compile(r" *(phalanx [a-z].*)")
MENTION = re.compile(r"`phalanx ([a-z][\w-]*)([^`\n]*)`")
CHEAP = {
    *("scenarios", "schema", "runs", "run", "check"),
    *("verify", "certify", "explain", "report", "animate", "export"),
}
"""Commands that end by themselves after a short run."""


class Shown(NamedTuple):
    """A command, and the file that shows it."""

    file: str
    text: str

    @property
    def arguments(self) -> list[str]:
        words, _, _ = self.text.partition(" > ")  # into a file
        return shlex.split(words, comments=True)[1:]


def blocks(page: str) -> Iterator[str]:
    """Yield the lines of a page's blocks of code, without those of Python and TOML."""
    fence = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.DOTALL | re.MULTILINE)
    yield from (text for language, text in fence.findall(page) if language in ("", "sh"))
    yield from re.findall(r"^    .*\n", page, re.MULTILINE)


def shown() -> Iterator[Shown]:
    """Yield the commands of blocks of code, and of the examples in helps."""
    for path in [*PAGES, *SOURCES]:
        text = path.read_text("utf-8")
        for block in blocks(text) if path.suffix == ".md" else re.findall(r"^ {6}\S.*", text, re.M):
            for line in block.replace("\\\n", " ").splitlines():
                if match := COMMAND.fullmatch(line):
                    yield Shown(str(path.relative_to(ROOT)), re.sub("  +", " ", match[1]))


COMMANDS = sorted({one for one in shown() if one.arguments[0] not in OF_EXAMPLES})


def parameters(arguments: list[str]) -> dict[str, Any]:
    """Return the values of a command's parameters, as the command line reads them."""
    require_values(arguments)
    refuse_secrets(arguments)
    group = get_command(extended())
    above = group.make_context("phalanx", with_factor(arguments))
    name, command, rest = group.resolve_command(above, [*above._protected_args, *above.args])
    return command.make_context(name, rest, parent=above).params


def test_commands_of_pages_and_helps_are_read():
    names = {command.arguments[0] for command in COMMANDS}
    assert {"run", "check", "study", "attack", "agent", "keys", "explain", "view", "fit"} <= names
    assert {"README.md", "docs/worlds.md", "phalanx/cli/run.py"} <= {c.file for c in COMMANDS}


@pytest.mark.parametrize("command", COMMANDS, ids=lambda one: f"{one.file}: {one.text}")
def test_the_command_line_takes_a_command_as_it_is_shown(command, monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.syspath_prepend(str(ROOT / "examples" / "extension"))
    given = parameters(command.arguments)
    scenario = given.get("scenario") or "open"
    if scenario == "open" or scenario.endswith("study.toml") or A_USERS.match(scenario):
        return
    assert scenario in shipped() or Path(scenario).is_file()
    trusted = scenario not in shipped()
    assert load(scenario, given.get("overrides"), given.get("seed"), trust=trusted).agents


@pytest.mark.parametrize("page", [p for p in PAGES if p.name not in HISTORY], ids=lambda p: p.name)
def test_commands_that_a_page_mentions_exist_with_their_options(page):
    commands = get_command(extended()).commands
    for name, rest in MENTION.findall(page.read_text("utf-8")):
        options = {text for option in commands[name].params for text in option.opts}
        assert set(re.findall(r"--[a-z][\w-]*", rest)) <= options | {"--help"}, name


@pytest.mark.parametrize(
    "wrong", ["phalanx run unicycles --sed 3", "phalanx rum unicycles", "phalanx view a b"]
)
def test_a_command_with_a_mistake_is_found(wrong):
    with pytest.raises(Exception, match=r"No such|unexpected"):
        parameters(Shown("", wrong).arguments)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the examples, and a run of each scenario of which pages show one."""
    folder = tmp_path_factory.mktemp("user")
    for name in ("examples", "evidence"):
        (folder / name).symlink_to(ROOT / name)
    swap = str(ROOT / "evidence" / "explanation" / "swap.toml")
    for scenario in ("unicycles", "crossing", swap):
        words = ["--set", "duration=5", "--engine", "in-process", "--out", f"{folder}/runs"]
        assert status(["run", scenario, *words, "--no-report"]) == 0
    return folder


def is_cheap(command: Shown) -> bool:
    name, *rest = command.arguments
    dear = {"--view", "--real-time", "/data/runs"} & set(rest)
    return name in CHEAP and not dear and not any(map(A_USERS.match, rest))


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.swarm
@pytest.mark.parametrize(
    "command", [one for one in COMMANDS if is_cheap(one)], ids=lambda one: f"{one.file}: {one.text}"
)
def test_a_cheap_command_runs_as_it_is_shown(command, folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(ROOT / "examples" / "extension"))
    shortened = ["--set", "duration=0.5"] if command.arguments[0] == "run" else []
    assert status([*command.arguments, *shortened]) in (0, 1, 2)
