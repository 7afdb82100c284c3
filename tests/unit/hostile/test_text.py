"""A recording whose every text is hostile: whatever prints from it, or shows it, shows text."""

import json
from pathlib import Path

import msgspec
import pytest

import phalanx
from phalanx.cli.app import status
from phalanx.faults.commands import Command
from phalanx.guarantee.verdict import Assumption, FaultCount, Outcome, Violation
from phalanx.recording.records import RECORDING, Log
from phalanx.recording.write import RecordingWriter
from phalanx.scenario.model import Reading, Scenario
from tests.unit.report.recordings import drift, summary_of, unicycles

pytestmark = pytest.mark.slow

MARKUP, TAGS = "[/red][bold]", "<!--<script>alert(1)</script>"
HOSTILE = (
    f"{MARKUP}\x1b]0;owned\x07\x1b[2J\rno\ncertified: all\u2028of it\u202e{TAGS}\x85\ud7ff\x9b1m"
)


def recorded(folder: Path, scenario: Scenario, *, outcome: Outcome = Outcome.VIOLATED) -> str:
    """The folder of a recording of it that holds a hostile text wherever it holds a text."""
    folder.mkdir()
    summary = msgspec.structs.replace(
        summary_of(scenario, HOSTILE),
        outcome=outcome,
        trajectory=HOSTILE,
        worst_pair=HOSTILE,
        origins={HOSTILE: 1},
        assumptions=[Assumption(HOSTILE, 1, 2, 0.1, HOSTILE)],
        theorem=[Assumption(f"{HOSTILE} ", 1, 2, 0.1, HOSTILE)],
        violations=[Violation(HOSTILE, 0.2, 0.25, 0.3, 0.15, 1, 0.2, 0.35)],
        rejected={HOSTILE: 7},
        faults=[FaultCount(HOSTILE, 0)],
    )
    with RecordingWriter(folder / RECORDING, scenario, HOSTILE) as writer:
        for entry in drift(scenario):
            if hasattr(entry, "fates"):
                entry.faults = [(sender, k, [HOSTILE]) for sender, k, _ in entry.fates]
            writer.write(entry)
        writer.write(Log(0.1, HOSTILE))
        writer.write(Command(0.2, HOSTILE, HOSTILE))
        writer.finish(summary)
    return str(folder)


@pytest.fixture
def hostile(tmp_path: Path) -> str:
    reading = Reading(source=HOSTILE, overrides={HOSTILE: HOSTILE})
    scenario = unicycles()
    return recorded(
        tmp_path / HOSTILE.replace("/", ""),
        scenario.model_copy(update={"description": HOSTILE, "reading": reading}),
    )


@pytest.fixture
def misnamed(tmp_path: Path) -> str:
    """A recording with an agent of a hostile name, which no scenario may have."""
    scenario = unicycles()
    first, *others = scenario.agents
    named = first.model_copy(update={"names": (HOSTILE, *first.names[1:])})
    return recorded(tmp_path / "misnamed", scenario.model_copy(update={"agents": (named, *others)}))


def printable_output(capsys: pytest.CaptureFixture[str]) -> str:
    """Return the output: lines of printable text, none of them from the recording alone."""
    out, err = capsys.readouterr()
    assert [line for line in (out + err).split("\n") if not line.isprintable()] == []
    assert not any(line.startswith("certified: all") for line in out.split("\n"))
    return out + err


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(["report", "RUN"], marks=pytest.mark.nightly),
        ["verify", "RUN", "--engine", "in-process"],
        ["certify", "RUN"],
        ["export", "RUN", "--html", "OUT.html", "--mcap", "OUT.mcap", "--csv", "OUT"],
        ["runs", "RUNS"],
    ],
    ids=lambda command: command[0],
)
def test_a_command_prints_text(
    command: list[str], hostile: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = {"RUN": hostile, "OUT": str(tmp_path / "out"), "OUT.html": str(tmp_path / "out.html")}
    paths |= {"RUNS": str(tmp_path), "OUT.mcap": str(tmp_path / "out.mcap")}
    status([paths.get(part, part) for part in command])
    assert printable_output(capsys)
    for page in tmp_path.glob("**/*.html"):
        assert TAGS not in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "command", [["report"], ["verify"], ["certify"], ["view"], ["export", "--html", "x.html"]]
)
def test_an_agent_of_a_name_that_no_agent_has_is_refused_in_text(
    command: list[str], misnamed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    name, *rest = command
    assert status([name, misnamed, *(misnamed if part == "RUN" else part for part in rest)]) == 3
    assert "expected 1 to 32 of a-z 0-9 _ -" in printable_output(capsys)


def test_check_prints_the_text_of_a_scenario_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    escape = tmp_path / "hostile.toml"
    escape.write_text(f"{json.dumps(HOSTILE)} = 1\n", encoding="utf-8")
    assert status(["check", str(escape)]) == 64
    assert "unknown field" in printable_output(capsys)


def test_the_figures_of_a_run_are_printed_as_text(
    hostile: str, capsys: pytest.CaptureFixture[str]
) -> None:
    from phalanx.cli.display import last_line, print_summary
    from phalanx.launcher.streams import echo

    summary = phalanx.open(hostile).summary
    assert summary is not None
    print_summary(summary)
    echo(last_line(summary))
    assert MARKUP in printable_output(capsys)


def test_a_notebook_shows_text(hostile: str) -> None:
    page = phalanx.open(hostile)._repr_html_()
    assert "<script" not in page
    assert "alert(1)" in page


def test_a_line_of_a_programs_log_is_printable(capsys: pytest.CaptureFixture[str]) -> None:
    import logging

    from phalanx.launcher.streams import PrintableFormatter

    record = logging.LogRecord("x", logging.WARNING, "", 0, "no replay: %s", (HOSTILE,), None)
    assert PrintableFormatter("%(asctime)s %(message)s").format(record).isprintable()
