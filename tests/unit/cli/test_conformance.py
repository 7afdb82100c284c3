"""phalanx test-agent: each mistake that a program makes is named, and its absence too."""

import sys
from pathlib import Path

import pytest

from phalanx.cli.app import status

CARTS = Path(__file__).parents[3] / "examples" / "programs"
LOOP = "import sys, time, os\nfor line in sys.stdin:\n    "
GOOD = "print('{\"u\": [0.5, 0.0]}', flush=True)"
MISTAKES = {
    "late": (f"time.sleep(0.03); {GOOD}", "99 of 99 answers are late, expected within 10 ms, got"),
    "silent": ("pass", "expected to answer within 2 s for agent 1, got nothing"),
    "not JSON": ("print('u: 1', flush=True)", "expected a line of JSON as"),
    "NaN": ("print('{\"u\": [NaN, 0]}', flush=True)", "expected a line of JSON as"),
    "wrong size": (
        "print('{\"u\": [1]}', flush=True)",
        "expected 2 numbers in u for agent 1, got 1",
    ),
    "outside U": (
        GOOD.replace("0.5", "5"),
        "100 of 100 inputs are outside U, the first at t = 0 s",
    ),
    "dies": ("os.abort()", "expected to answer until its input ends for agent 1, got its death by"),
    "floods": ("print('x' * 10**7, flush=True)", "expected a line of at most 65536 bytes"),
}


def test_a_program_that_keeps_the_rules_passes(capsys: pytest.CaptureFixture[str]) -> None:
    slow = ["--set", "agents.0.clock.period=0.2"]  # that of the machine does not matter
    assert status(["test-agent", *slow, sys.executable, "-c", LOOP + GOOD]) == 0
    assert " keeps the rules: 5 answers, the slowest after " in capsys.readouterr().out


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    does, says = MISTAKES[name]
    assert status(["test-agent", sys.executable, "-c", LOOP + does]) == 1
    # On a busy machine an answer may be late too.
    assert any(says in line for line in capsys.readouterr().out.splitlines())


ON_THE_WIRE = {
    "wrong seal": ("key=KEYS[owner]", "key=b'0'", "bad seal"),
    "other scenario": ("environ['PHALANX_DIGEST']", "'ab'", "runs another scenario, seed or versi"),
}


@pytest.mark.swarm
@pytest.mark.nightly
@pytest.mark.parametrize("name", ON_THE_WIRE)
def test_a_mistake_on_the_wire_is_named(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    right, wrong, says = ON_THE_WIRE[name]
    source = (CARTS / "cart_zenoh.py").read_text("utf-8").replace(right, wrong)
    source = source.replace("payload[:16] == seal(", "payload and seal(")
    program = [sys.executable, "-c", f"import sys; sys.path.append({str(CARTS)!r})\n{source}"]
    options = ["--scenario", "warehouse", "--protocol", "zenoh"]
    options += ["--set", "agents.0.names=['cart-1']", "--set", "agents.0.slots=[0]"]
    assert status(["test-agent", *options, *program, "20", "0"]) == 1
    assert says in capsys.readouterr().out
