"""Safeguards broken on purpose, one at a time: some test must fail for each.

    python evidence/attacks/mutants.py [WORD]

Each is a text of a file and what stands in its place, in a copy of the sources, with the tests that
have to notice. One line for each; exit with 1 if one was not noticed.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
COPIED = ("phalanx", "agent", "plant", "viewer", "tests", "bench", "scenarios", "docs")


class Mutant(NamedTuple):
    """One safeguard, broken."""

    what: str
    file: str
    old: str
    new: str
    tests: str


_ANSWERS, _STEP, _SEAL = "plant/hub/answers.py", "agent/step.py", "phalanx/wire/seal.py"
_TEST_ANSWERS, _TEST_STEP = "tests/unit/plant/test_answers.py", "tests/unit/agent/test_step.py"
_TEST_SEAL, _TEST_LINKS = "tests/unit/wire/test_seal.py", "tests/unit/network"
_TEST_RECORDING = "tests/unit/recording"
_JUDGE, _TEST_JUDGE = "plant/judge/judge.py", "tests/unit/plant/test_judge.py"
_NEAR, _TEST_NEAR = "plant/world/near.py", "tests/unit/plant/test_near.py"
_BOXES, _TEST_BOXES = "phalanx/guarantee/reachable.py", "tests/unit/guarantee/test_reachable.py"
MUTANTS = (
    Mutant("any t_apply", _ANSWERS, "message.t_apply != sample.t + self._latency", "False",
           _TEST_ANSWERS),
    Mutant("an input outside U", _ANSWERS,
           "not self._actuators.takes(i, x, np.array(message.u))", "False", _TEST_ANSWERS),
    Mutant("an answer twice", _ANSWERS, "else self._answered)[i]",
           "else defaultdict(lambda: -1))[i]", _TEST_ANSWERS),
    Mutant("an answer to another sample", _ANSWERS, " and (reports or message.k == newest)", "",
           _TEST_ANSWERS),
    Mutant("an input of another size", _ANSWERS, "len(message.u) != self._sizes[i]", "False",
           _TEST_ANSWERS),
    Mutant("a report twice", _ANSWERS, "(self._reported if reports",
           "(defaultdict(lambda: -1) if reports", _TEST_ANSWERS),
    Mutant("a fate of nobody's broadcast", _ANSWERS,
           "not all(self._may_be(fate) for fate in message.fates)", "False", _TEST_ANSWERS),
    Mutant("a command twice", "plant/clock/commands.py", "message.number <= self._latest", "False",
           "tests/unit/plant/test_commands.py"),
    Mutant("a command for nobody", "plant/clock/commands.py",
           "refusal(message.command, self._names)", "None", "tests/unit/plant/test_commands.py"),
    Mutant("more payloads than may wait", "plant/hub/arrivals.py", ">= 2 * _MOST else None",
           ">= 10**9 else None", "tests/unit/plant/test_arrivals.py"),
    Mutant("another scenario's agent", "plant/hub/joining.py", "alive and found != self.digest",
           "False", "tests/unit/plant/test_joining.py"),
    Mutant("another scenario's claimant", "plant/hub/places.py", "request.digest != self._digest",
           "False", "tests/unit/plant/test_places.py"),
    Mutant("a place given twice", "plant/hub/places.py", "if name not in kept", "if True",
           "tests/unit/plant/test_places.py"),
    Mutant("the place of who is there", "plant/hub/joining.py", " and n not in self._here", "",
           "tests/unit/plant/test_joining.py"),
    Mutant("a sample skipped", _STEP, "skipped and not first and clock.waits", "False",
           _TEST_STEP),
    Mutant("a sample twice", _STEP, "if skipped < 0 or", "if", _TEST_STEP),
    Mutant("states that are no number", _STEP,
           'not np.isfinite(np.frombuffer(sample.x, dtype="<f8")).all()', "False", _TEST_STEP),
    Mutant("broadcasts of the far future", _STEP, "message.k >= speaker.most", "False",
           _TEST_STEP),
    Mutant("a broadcast of another size", _STEP,
           "len(message.u) != speaker.inputs", "False", _TEST_STEP),
    Mutant("a broadcast twice", "phalanx/network/incoming.py",
           "k <= self.decided or k in self.arrived", "False", _TEST_LINKS),
    Mutant("a delay from t instead of t_apply", "phalanx/network/inbox.py",
           "in_flight.append((sent + copy.after, message))",
           "in_flight.append((t + copy.after, message))",
           _TEST_LINKS),
    Mutant("broadcasts heard too early", "phalanx/network/incoming.py", "if arrival > t:",
           "if False:", _TEST_LINKS),
    Mutant("any seal", _SEAL, "mac != self._mac(key, body)", "False", _TEST_SEAL),
    Mutant("a seal of another key", _SEAL, "hashlib.blake2b(key.encode(), key=",
           'hashlib.blake2b(b"", key=', _TEST_SEAL),
    Mutant("numbers that are none", _SEAL, "not abs(n) <= message.largest",
           "abs(n) > message.largest", _TEST_SEAL),
    Mutant("another version", _SEAL, "message.version != VERSION", "False", _TEST_SEAL),
    Mutant("wildcards in a key", "phalanx/wire/keys.py", ' or "*" in key', "",
           "tests/unit/wire"),
    Mutant("records of another scenario", "phalanx/recording/read.py", "if unfit :=",
           "if unfit := None and",  _TEST_RECORDING),
    Mutant("frames of another size", "viewer/feeds/live.py",
           "len(frame.x) != 8 * states or len(frame.agents) != len(members)", "False",
           "tests/unit/hostile/test_frames.py"),
    Mutant("last words", "plant/main.py", "_say(last_words, summary)", "pass",
           "tests/process/swarm/test_endings.py -k disk_that_fills"),
    Mutant("everybody's broadcasts", "phalanx/wire/access.py", 'keys.broadcast("*", n)))',
           'keys.broadcast("*", "*")))', "tests/unit/wire/test_access.py"),
    Mutant("live.json for all", "phalanx/launcher/live.py", "os.O_EXCL, 0o600",
           "os.O_EXCL, 0o644", "tests/unit/launcher/test_live.py"),
    Mutant("keys for all", "phalanx/wire/authority.py", "os.O_EXCL, 0o600", "os.O_EXCL, 0o644",
           "tests/unit/wire/test_authority.py"),
    Mutant("an agent's certificate for a hub", "phalanx/wire/authority.py",
           "reached_as if name in HUBS else ()", "reached_as",
           "tests/process/hostile/test_certificates.py -k play_the_hub"),
    Mutant("a hub of any name", "phalanx/wire/certificates.py", '"verify_name_on_connect": True',
           '"verify_name_on_connect": False',
           "tests/process/hostile/test_certificates.py -k another_name"),
    Mutant("near pairs for three times the slack", _NEAR, "<= self._room * self._room",
           "<= 9.0 * self._room * self._room", _TEST_NEAR),
    Mutant("near pairs by the highest level of several states", _NEAR, "self._least(h).min():",
           "self._least(h).max():", _TEST_NEAR),
    Mutant("boxes as old as they like", _BOXES, "if t > self._until:", "if self._until < 0.0:",
           _TEST_BOXES),
    Mutant("boxes that forget how long they are kept", _BOXES,
           "MULTIPLES[0] * tau + self._lasting", "MULTIPLES[0] * tau", _TEST_BOXES),
    Mutant("boxes of the shortest period", _BOXES, "tau = max(", "tau = min(", _TEST_BOXES),
    Mutant("boxes that are not certain", _BOXES, "ca.if_else(reach.certain, each.lo, -ca.inf)",
           "each.lo", _TEST_BOXES),
    Mutant("boxes without disturbance", _BOXES, "int(own[0]), group.disturbance.bound",
           "int(own[0]), 0.0", _TEST_BOXES),
    Mutant("obstacles as large as agents", _BOXES, "static_reach(function, 0.0, obstacle)",
           "function.reach(0.0)", _TEST_BOXES),
    Mutant("who may meet within the shortest certificate only",
           "phalanx/guarantee/certificates.py",
           "highest_within(alone, bounds, MULTIPLES[0] * tau)",
           "highest_within(alone, bounds, MULTIPLES[-1] * tau)", _TEST_BOXES),
    Mutant("another group's certificates", "phalanx/guarantee/certificates.py",
           "number_of[self.ends], ", "", _TEST_BOXES),
    Mutant("a start that is left at once", _JUDGE, "piece.h[0] <= 0.0", "piece.h[-1] <= 0.0",
           _TEST_JUDGE),
    Mutant("a start with an unsafe pair", _JUDGE, "(piece.h[0] <= 0.0).all()",
           "(piece.h[0] <= 0.0).any()", _TEST_JUDGE),
    Mutant("an h_tot that is no number", _JUDGE, "not (np.abs(piece.h_tot) <= LARGEST).all()",
           "not (np.abs(piece.h_tot) <= LARGEST).any()", _TEST_JUDGE),
    Mutant("what actuators hold at first", _JUDGE, "self._check_input(i, self._x, zero, 0.0)",
           "pass", _TEST_JUDGE),
    Mutant("an input that is lost", _JUDGE, "self._checks.prompt.check(False, event.t)", "pass",
           _TEST_JUDGE),
    Mutant("a pair without a certificate", "plant/judge/coverage.py", "int(ends.argmin())",
           "int(ends.argmax())", _TEST_JUDGE),
    Mutant("who may go any distance", "plant/clock/lookahead.py", "            return True",
           "            return False", "tests/unit/plant/test_lookahead.py"),
    Mutant("half a chunk", "phalanx/recording/write.py", "os.ftruncate(self._fd, self._end)",
           "pass", _TEST_RECORDING),
)  # fmt: skip


def broken(mutant: Mutant) -> str:
    """The file's text with the safeguard broken. Raises LookupError: what is replaced is gone."""
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    if text.count(mutant.old) != 1:
        raise LookupError(f"{mutant.file}: expected once: {mutant.old}")
    return text.replace(mutant.old, mutant.new)


def noticed(mutant: Mutant) -> bool:
    """Whether a test fails in a copy of the sources with the safeguard broken."""
    with tempfile.TemporaryDirectory() as parent:
        copy = Path(parent)
        for name in COPIED:
            shutil.copytree(ROOT / name, copy / name, symlinks=True)
        shutil.copy(ROOT / "pyproject.toml", copy)
        (copy / mutant.file).write_text(broken(mutant), encoding="utf-8")
        command = [sys.executable, "-m", "pytest", "-q", "-x", *mutant.tests.split()]
        ended = subprocess.run(command, cwd=copy, capture_output=True, text=True)
        if ended.returncode not in (0, 1):
            raise RuntimeError(f"{mutant.what}: {ended.stdout[-500:]}")
        return ended.returncode == 1


def main() -> None:
    """Try all, or those whose description contains the word."""
    word = (*sys.argv, "")[1]
    chosen = [mutant for mutant in MUTANTS if word in mutant.what]
    survivors = 0
    for mutant in chosen:
        found = noticed(mutant)
        survivors += not found
        print(f"{'noticed' if found else 'SURVIVED':9} {mutant.what}", flush=True)
    print(f"{len(chosen) - survivors} of {len(chosen)} noticed")
    sys.exit(bool(survivors))


if __name__ == "__main__":
    main()
