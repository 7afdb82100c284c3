"""A run's output in a terminal of 80 columns, and the progress of many runs where there is none."""

import re
from io import StringIO

import msgspec
import pytest
from rich.console import Console

import phalanx
from phalanx.cli import display
from phalanx.guarantee.verdict import FaultCount
from phalanx.messages.kinds import Status
from tests.unit.report.recordings import summary_of

_CONTROL = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")


@pytest.fixture
def screen(monkeypatch):
    text = StringIO()
    console = Console(file=text, width=80, force_terminal=True)
    monkeypatch.setattr(display, "Console", lambda stderr: console)
    return text


def lines(screen: StringIO) -> list[str]:
    """Return the lines of the screen."""
    return re.split(r"[\r\n]+", re.sub(r"\x1b\[2K|\x1b\[1A", "\n", screen.getvalue()))


def test_the_progress_bar_fits_80_columns(screen):
    longest = Status(t=138.25, real_time_factor=112.3, worst_h=-0.0001234, backups=12345)
    with display.progress(phalanx.load("formation3d-distance")) as show:
        show(longest)
    (line,) = [_CONTROL.sub("", part) for part in lines(screen) if "backups" in part]
    assert len(line) <= 80
    for part in ("138.25/140 s", "112.3x", "worst h -0.000123", "backups 12345"):
        assert part in line


def test_agents_that_are_waited_for_leave_the_line_whole(screen):
    waiting = Status(waiting_for=tuple(f"agent-number-{n}" for n in range(12)))
    with display.progress(phalanx.load("formation3d-distance")) as show:
        show(waiting)
    waiting_lines = [_CONTROL.sub("", part) for part in lines(screen) if "have joined" in part]
    assert waiting_lines
    assert all(len(line) <= 80 for line in waiting_lines)


def test_the_last_line_of_a_stopped_run_names_who_was_unsafe_until_then():
    violated = summary_of(phalanx.load("unicycles"), "by Ctrl-C")
    stopped = msgspec.structs.replace(violated, outcome=phalanx.Outcome.STOPPED)
    assert display.last_line(stopped) == (
        "stopped: by Ctrl-C; until then these left the safe set: 1-4"
    )
    whole = msgspec.structs.replace(stopped, violations=[])
    assert display.last_line(whole) == "stopped: by Ctrl-C"
    assert display.last_line(violated) == "violated: by Ctrl-C"


def test_the_last_line_and_the_table_name_agents_that_were_lost(capsys):
    lost = ["agent 1 at t = 0.100 s (agent 1 failed)", "agent 2 at t = 0.200 s"]
    summary = summary_of(phalanx.load("unicycles"), "1-4 left the safe set")
    summary = msgspec.structs.replace(summary, lost=lost)
    assert display.last_line(summary) == (
        "violated: 1-4 left the safe set; lost: agent 1 at t = 0.100 s (agent 1 failed); "
        "lost: agent 2 at t = 0.200 s"
    )
    display.print_summary(summary)
    rows = [line.split()[:3] for line in capsys.readouterr().out.splitlines() if "lost" in line]
    assert rows == [["lost", "agent", "1"], ["lost", "agent", "2"]]


def test_what_is_refused_before_it_begins_shows_no_bar(screen):
    with display.progress(phalanx.load("formation3d-distance")):
        pass
    assert screen.getvalue() == ""


def test_a_summary_names_all_that_failed_was_unsafe_or_never_happened(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    faults = [FaultCount("network.loss", n) for n in (0, 1, 2)]
    summary = summary_of(phalanx.load("unicycles"))
    (unsafe,) = summary.violations
    turned = [msgspec.structs.replace(unsafe, pair=pair) for pair in ("2-4", "2-5")]
    others = {"excluded": turned, "rejected": {"out of order": 3, "bad seal": 1}}
    summary = msgspec.structs.replace(summary, faults=faults, **others)
    display.print_summary(summary, {"task": "arrived", "waiting": ""})
    rows = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    for row in (
        "verdict violated",
        "certificates failed 3 of 120",
        "of the theorem: non-empty K_i failed 24 of 120",
        "violated 1-4: h up to 0.25 at t = 0.300 s, 0.150 s from t = 0.200 s to 0.350 s",
        "turned, not counted 2-4: h up to 0.25, 0.150 s from t = 0.200 s to 0.350 s",
        "turned, not counted 2-5: h up to 0.25, 0.150 s from t = 0.200 s to 0.350 s",
        "payloads dropped 3 out of order",
        "payloads dropped 1 bad seal",
        "fault: network.loss never had an effect",
        "fault: network.loss once",
        "fault: network.loss 2 times",
        "task arrived",
    ):
        assert row in rows
    assert not [row for row in rows if row.startswith("waiting")]


def test_a_bar_of_runs_is_gone_when_they_are_done(screen):
    with display.progress_of_runs(4) as show:
        show("cma-es", 4, "all safe")
    assert "cma-es" in screen.getvalue()
    assert screen.getvalue().endswith("\r\x1b[1A\x1b[2K")


@pytest.mark.parametrize(("every", "lines"), [(1e6, 1), (0.0, 5)])
def test_without_a_terminal_it_is_a_line_now_and_then(capsys, monkeypatch, every, lines):
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    monkeypatch.setattr(display, "_EVERY", every)
    with display.progress_of_runs(400) as show:
        for count in range(0, 400, 80):
            show("cma-es", count, f"{count} [violated]")
    printed = capsys.readouterr()
    assert printed.out == ""
    lines_printed = printed.err.splitlines()
    assert len(lines_printed) == lines
    assert re.fullmatch(r"cma-es .* 0/400 0 \[violated\] -:--:--\s*", lines_printed[0])
    if lines > 1:
        assert re.fullmatch(
            r"cma-es .* 320/400 320 \[violated\] \d:\d\d:\d\d\s*", lines_printed[-1]
        )
