"""Commands of other packages, and what the core asks of extensions: found by entry points."""

import re
import sys
from pathlib import Path

import pytest
from typer.main import get_command

import phalanx
from phalanx.cli import app
from phalanx.cli.app import extended, status
from phalanx.cli.jobs import Job
from phalanx.schema import extensions
from phalanx.schema.extensions import MissingExtensionError, extension

GREET = """
def register(app):
    @app.command()
    def greet(name: str) -> int:
        \"\"\"Greet somebody.\"\"\"
        print(f"good day, {name}")
        return 0
"""


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Installs a package as pip does: its module, and the metadata of its distribution."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def install(package: str, source: str, entries: str) -> None:
        monkeypatch.delitem(sys.modules, package, raising=False)
        (tmp_path / f"{package}.py").write_text(source)
        metadata = tmp_path / f"{package}-1.0.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n"
        )
        (metadata / "entry_points.txt").write_text(entries)

    return install


def test_another_packages_command_is_one_of_phalanx(install, capsys):
    install("greeting", GREET, "[phalanx.commands]\ngreet = greeting:register\n")
    assert status(["greet", "Ada"]) == 0
    assert capsys.readouterr().out == "good day, Ada\n"
    assert status(["--help"]) == 0
    printed = capsys.readouterr().out
    assert "Greet somebody." in printed.partition(Job.PACKAGES)[2]


def test_every_command_is_under_its_job_in_the_help_in_the_order_of_jobs(capsys):
    panels = {name: one.rich_help_panel for name, one in get_command(extended()).commands.items()}
    assert {name for name, job in panels.items() if job not in set(Job) - {Job.PACKAGES}} == set()
    assert panels["run"] == Job.RUN
    assert panels["fit"] == Job.STUDY
    assert panels["certify"] == Job.CHECK
    assert status(["--help"]) == 0
    titles = re.findall(r"^╭─ (.*?) ─+╮$", capsys.readouterr().out, re.MULTILINE)
    assert titles == ["Options", *(job for job in Job if job != Job.PACKAGES)]


def test_a_panel_of_another_packages_comes_last(install, capsys):
    source = GREET.replace("command()", "command(rich_help_panel='Courtesy')")
    install("greeting", source, "[phalanx.commands]\ngreet = greeting:register\n")
    assert status(["--help"]) == 0
    assert re.findall(r"^╭─ (.*?) ─", capsys.readouterr().out, re.MULTILINE)[-1] == "Courtesy"


@pytest.mark.parametrize(
    ("source", "why"),
    [
        ("import no_such_module", "No module named 'no_such_module'"),
        ("import sys\nsys.exit(9)", "9"),
        ("def register(app):\n    raise TypeError('no such option')", "no such option"),
        (GREET.replace("greet", "report"), "there is a command 'report' already"),
    ],
    ids=[
        "cannot be imported",
        "exits when imported",
        "raises",
        "takes the name of another command",
    ],
)
def test_a_package_that_breaks_when_it_registers_keeps_no_other_command_from_running(
    source, why, install, capsys, tmp_path
):
    install("broken", source, "[phalanx.commands]\na = broken:register\n")
    assert status(["report", str(tmp_path)]) == 3
    printed = capsys.readouterr().err
    assert f"cannot load the commands 'a' of broken: {why}" in printed
    assert "recording" in printed


@pytest.mark.parametrize("error", ["MemoryError", "ImportError", "SystemError"])
def test_a_library_that_cannot_be_loaded_ends_a_command_with_the_status_of_a_failure(
    error, install, capsys
):
    broken = GREET.replace("        return 0", f"        raise {error}('libx')")
    install("greeting", broken, "[phalanx.commands]\ngreet = greeting:register\n")
    assert status(["greet", "Ada"]) == 3
    assert "too little memory, or a broken installation: libx" in capsys.readouterr().err


def test_what_the_core_brings_looks_for_no_extension(install, capsys, tmp_path):
    install("broken", "import no_such_module", "[phalanx.commands]\nbroken = broken:register\n")
    assert status(["runs", str(tmp_path)]) == 3
    assert "broken" not in capsys.readouterr().err


def test_what_an_extension_offers_is_found_by_its_name(install):
    offered = "[phalanx.extensions]\nanswer = answering:ANSWER\n"
    install("answering", "ANSWER = 42", offered)
    assert extension("answer") == 42
    with pytest.raises(MissingExtensionError, match="'question'"):
        extension("question")


def test_a_command_without_its_library_says_which_extra_brings_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "polars", None)
    monkeypatch.delitem(sys.modules, "phalanx_studies.study", raising=False)
    assert status(["study", "unicycles"]) == 3
    assert capsys.readouterr().err == "needs polars: pip install '.[lab]'\n"


def test_an_extension_of_a_package_that_is_not_installed_says_which(monkeypatch):
    monkeypatch.setattr(extensions, "entry_points", lambda **_: ())
    with pytest.raises(MissingExtensionError, match=r"pip install \./packages/phalanx-mcap$"):
        extension("mcap")
    with pytest.raises(MissingExtensionError, match=r"pip install \./packages/phalanx-studies$"):
        _ = phalanx.study


def test_a_command_of_a_package_that_is_not_installed_says_which(monkeypatch, capsys):
    monkeypatch.setattr(app.extensions, "commands", list)
    assert status(["certify", "runs/x"]) == 3
    said = capsys.readouterr().err
    assert "no commands of extensions are registered: " in said
    assert said.endswith("needs phalanx-certify: pip install ./packages/phalanx-certify\n")
    assert status(["attack", "weak"]) == 3
    assert capsys.readouterr().err.endswith(
        "needs phalanx-attacks: pip install ./packages/phalanx-studies ./packages/phalanx-attacks\n"
    )
