"""An agent's own program: asked by lines of JSON, and named in one line whatever it does."""

import select
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import pytest
from phalanx_agent.program import ProgramError, ProgramProcess

import phalanx
from phalanx.extend import Array, GiveWay, Law, TrackVelocity, View
from phalanx.scenario.load import from_json, load
from phalanx.scenario.model import ScenarioError, to_json
from phalanx.schema.user_code import code_trusted
from phalanx.swarm.swarm import build_swarm

EXAMPLES = Path(__file__).parents[3] / "examples" / "programs"
ANSWER = "import json, sys\nfor k, line in enumerate(sys.stdin):\n    u = [0.0, 0.0]\n    "
MISTAKES = {
    "hangs": ("while True: pass", "expected to answer within 0.5 s for agent 1, got nothing"),
    "ignores its input": ("import time; time.sleep(60)", "within 0.5 s for agent 1, got nothing"),
    "dies": ("sys.exit(3)", "to answer until its input ends for agent 1, got exit status 3"),
    "crashes": ("import os; os.abort()", "for agent 1, got its death by SIGABRT"),
    "closes": ("import os, time; os.close(1); time.sleep(60)", "got a closed stream"),
    "talks": ("print('hello', flush=True)", "expected a line of JSON as"),
    "NaN": ("print('{\"u\": [NaN, 0]}', flush=True)", "NaN"),
    "infinite": ("print('{\"u\": [1e400, 0]}', flush=True)", "1e400"),
    "too large": ("print('{\"u\": [1e301, 0]}', flush=True)", "expected finite numbers in u"),
    "wrong size": ("print('{\"u\": [0]}', flush=True)", "expected 2 numbers in u for agent 1, got"),
    "floods": (
        # Lines one by one could each come as the answer to another sample.
        "\n    while True: print('{\"u\": [0, 0]}\\n' * 99, flush=True)",
        "one line for each sample for agent 1",
    ),
    "10 MB": ("print('x' * 10**7, flush=True)", "a line of at most 65536 bytes for agent 1"),
}


def run(*program: str, **overrides: object) -> phalanx.Run:
    """A run of agent 1, decided by a program."""
    settings = {"agents.0.program": program, "duration": 0.2, "time.timeout": 1.0, **overrides}
    return phalanx.run(load("one-on-one", settings), engine="in-process")


@pytest.mark.slow
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_ends_in_one_line_with_the_programs_name(name: str) -> None:
    does, says = MISTAKES[name]
    patience = {} if "within" in says else {"time.timeout": 60.0}  # to start on a busy machine
    found = run(sys.executable, "-c", ANSWER + does, "mine", **patience).summary
    assert found.outcome == "broken"
    assert says in found.reason
    assert "mine: expected" in found.reason
    assert not [p for p in psutil.Process().children() if "mine" in p.cmdline()]


@pytest.mark.slow
def test_an_input_outside_u_is_projected_and_counted() -> None:
    does = "print(json.dumps({'u': [99.0, 0.0], 'log': 'fast'}), flush=True)"
    assert set(run(sys.executable, "-c", ANSWER + does).inputs["origin"]) >= {
        "controller-projected"
    }


@pytest.mark.slow
def test_a_program_has_until_the_earliest_next_sample() -> None:
    does = "d = json.loads(line); print(json.dumps({'u': [d['deadline'] - d['t'], 0]}), flush=True)"
    result = run(sys.executable, "-c", ANSWER + does, **{"agents.0.clock.jitter": 0.002})
    seconds = [step.u[0] for step in result.recording.steps if step.agent == "1"]
    assert seconds == pytest.approx([0.008] * len(seconds))
    assert len(seconds) > 10


@dataclass
class Cart(TrackVelocity):
    """The law of examples/programs/cart.py and cart.cpp inside Phalanx."""

    def input(self, view: View) -> Array:
        from examples.programs.cart import wheels

        goal = {name: each.tolist() for name, each in view.goal._asdict().items()}
        return np.array(wheels(view.x[view.i].tolist(), goal))


@dataclass
class Robot(GiveWay):
    """The law of examples/programs/robot.py and robot.cpp inside Phalanx."""

    def input(self, view: View) -> Array:
        from examples.programs.robot import acceleration

        states = {l: x.tolist() for l, x in view.x.items()}
        peers = {l: {"x": x} for l, x in states.items() if l != view.i}
        goal = {"position": view.goal.position.tolist()}
        return np.array(acceleration({"x": states[view.i], "goal": goal, "peers": peers}))


FAULTS = [
    {"kind": "partition", "at": 0.2, "for": 0.3, "groups": [["1", "2"]]},
    {"kind": "kill", "agents": ["3"], "at": 0.2},
    {"kind": "hijack", "agents": ["6"], "at": 0.3},
]
PROGRAM = {"agents.0.program": [sys.executable, str(EXAMPLES / "cart.py")]}


def same_bits(scenario: str, law: Law, programs: list[list[str]], **changes: object) -> phalanx.Run:
    """The run of programs behind the filter, which has the bits of the same law inside."""
    inside = phalanx.run(load(scenario, {**changes, "agents.0.law": law}), engine="in-process")
    for program in programs:
        own = {**changes, "agents.0.program": program, "agents.0.filter": True}
        outside = phalanx.run(load(scenario, own), engine="in-process")
        assert outside.summary.trajectory == inside.summary.trajectory
        assert outside.summary.faults == inside.summary.faults
    return outside


def in_both_languages(name: str, folder: Path) -> list[list[str]]:
    """Return the commands of an example in C++, which is built, and in Python."""
    options = ["-O2", "-ffp-contract=off", "-o", folder / name]
    subprocess.run(["g++", *options, EXAMPLES / f"{name}.cpp"], check=True)
    return [[str(folder / name)], [sys.executable, str(EXAMPLES / f"{name}.py")]]


@pytest.mark.nightly
@pytest.mark.slow
def test_programs_in_two_languages_give_the_bits_of_the_same_law_inside(tmp_path: Path) -> None:
    programs = in_both_languages("cart", tmp_path)
    assert same_bits("warehouse", Cart(), programs, duration=0.3).verdict == "guaranteed"


@pytest.mark.slow
def test_programs_know_their_peers_by_radio_in_spite_of_faults(tmp_path: Path) -> None:
    robot, programs = Robot(gains=(1.0, 4.0), speed=3.0), in_both_languages("robot", tmp_path)
    run = same_bits("radio", robot, programs, duration=0.6, faults=FAULTS)
    assert run.verdict == "safe"
    assert all(fault.count for fault in run.summary.faults)


def test_others_count_on_a_program_only_if_it_says_what_it_keeps() -> None:
    def sharing(**fields: object) -> int:
        given = {f"agents.0.{name}": value for name, value in fields.items()}
        return len(build_swarm(load("warehouse", {**PROGRAM, **given})).sharing)

    assert [sharing(), sharing(keeps="halves"), sharing(filter=True)] == [0, 3, 3]
    with pytest.raises(ScenarioError, match=r"program: expected with it keeps = 'own-parts' or"):
        load("radio", PROGRAM)
    with pytest.raises(ScenarioError, match=r"keeps: expected 'own-parts', as the others have"):
        load("radio", {**PROGRAM, "agents.0.keeps": "halves"})
    with pytest.raises(ScenarioError, match=r"filter: expected none without a program"):
        load("radio", {"agents.0.filter": True})


@pytest.mark.slow
def test_nothing_runs_without_trust_or_a_file() -> None:
    program = ["./elsewhere"]
    with pytest.raises(ScenarioError, match=r"names code of its own, ./elsewhere, which is not ru"):
        load("warehouse", {"agents.0.program": program}, trust=False)
    with pytest.raises(ScenarioError, match=r"no program to run: ./elsewhere for cart-1"):
        phalanx.run(load("warehouse", {"agents.0.program": program}), engine="in-process")
    recorded = to_json(load("warehouse", {"agents.0.program": program}))
    other = recorded.replace("./elsewhere", "./other")
    with pytest.raises(ScenarioError, match=r"names code of its own, ./other"), code_trusted(False):
        from_json(other)
    assert from_json(other).agents[0].program == ("./other",), "what failed changed no trust"


@pytest.mark.slow
def test_verify_names_a_program_that_is_not_deterministic() -> None:
    does = "print(json.dumps({'u': [time.time() % 1, 0.0]}), flush=True)"
    found = run(sys.executable, "-c", f"import time; {ANSWER}{does}", duration=0.05)
    words = str(phalanx.verify(found, engine="in-process"))
    assert "u.vx recorded" in words
    assert words.endswith("is not deterministic")


@pytest.mark.slow
def test_a_line_more_is_an_error_at_the_next_sample_whenever_it_comes(tmp_path: Path) -> None:
    late = tmp_path / "late.py"
    late.write_text(
        "import sys, time\n"
        "sys.stdin.readline(); print('{\"u\": [1]}', flush=True)\n"
        "time.sleep(0.05); print('{\"u\": [2]}', flush=True); sys.stdin.read()\n"
    )
    process = ProgramProcess([sys.executable, str(late)], {}, 20.0)
    assert process.ask(b"{}") == b'{"u": [1]}'
    select.select([process._from], [], [], 20.0)
    with pytest.raises(ProgramError, match="one line for each sample, got more of them"):
        process.ask(b"{}")


@pytest.mark.slow
def test_a_program_gets_no_secret_of_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHALANX_SECRET", "s")
    monkeypatch.setenv("PHALANX_COMMAND_SECRET", "c")
    said = "import os; print([n for n in os.environ if 'SECRET' in n], flush=True); input()"
    process = ProgramProcess([sys.executable, "-c", f"input(); {said}"], {}, 20.0)
    assert process.ask(b"{}") == b"[]"
