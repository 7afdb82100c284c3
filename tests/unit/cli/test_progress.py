"""The progress of many runs where no terminal is: a line now and then, with the time left."""

import re

import pytest

from phalanx.cli import display


@pytest.mark.parametrize(("every", "lines"), [(1e6, 1), (0.0, 5)])
def test_without_a_terminal_it_is_a_line_now_and_then(capsys, monkeypatch, every, lines):
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    monkeypatch.setattr(display, "_EVERY", every)
    with display.progress_of_runs(400) as show:
        for done in range(0, 400, 80):
            show("cma-es", done, f"{done} [violated]")
    printed = capsys.readouterr()
    assert printed.out == ""
    lines_printed = printed.err.splitlines()
    assert len(lines_printed) == lines
    assert re.fullmatch(r"cma-es .* 0/400 0 \[violated\] -:--:--\s*", lines_printed[0])
    if lines > 1:
        assert re.fullmatch(
            r"cma-es .* 320/400 320 \[violated\] \d:\d\d:\d\d\s*", lines_printed[-1]
        )
