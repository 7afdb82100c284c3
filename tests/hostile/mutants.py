"""Safeguards to be broken on purpose, one at a time: some test must fail for each.

Each is a text of a file and what stands in its place, with the tests that have to notice.
"""

from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]


class Mutant(NamedTuple):
    """One safeguard, broken."""

    what: str
    file: str
    old: str
    new: str
    tests: str


_PLANT, _STEP = "plant/phalanx_plant", "agent/phalanx_agent/step.py"
_ANSWERS, _SEAL = f"{_PLANT}/hub/answers.py", "phalanx/messages/seal.py"
_TEST_ANSWERS, _TEST_STEP = "tests/unit/plant/test_answers.py", "tests/unit/agent/test_step.py"
_TEST_SEAL, _TEST_LINKS = "tests/unit/messages/test_seal.py", "tests/unit/network"
_TEST_RECORDING = "tests/unit/recording"
_JUDGE, _TEST_JUDGE = f"{_PLANT}/judge/judge.py", "tests/unit/plant/test_judge.py"
_PAIRS, _TEST_PAIRS = f"{_PLANT}/world/evaluation.py", "tests/unit/plant/test_relevant_pairs.py"
_BOXES, _TEST_BOXES = "phalanx/guarantee/reachable.py", "tests/unit/guarantee/test_reachable.py"
_ACCESS, _TEST_ACCESS = "phalanx/messages/admission.py", "tests/unit/identities/test_access.py"
_ASSUMED, _COVERAGE = f"{_PLANT}/judge/assumptions.py", f"{_PLANT}/judge/coverage.py"
_LOOKAHEAD, _TEST_LOOKAHEAD = f"{_PLANT}/clock/lookahead.py", "tests/unit/plant/test_lookahead.py"
_EXTREMES, _TEST_EXTREMES = f"{_PLANT}/world/extremes.py", "tests/unit/plant/test_extremes.py"
_SENSING, _TEST_SENSING = f"{_PLANT}/sampling/sensing.py", "tests/unit/plant/test_sensing.py"
_SCHEDULE, _TEST_ONBOARD = (
    f"{_PLANT}/sampling/sampling.py",
    "tests/unit/plant/test_onboard_links.py",
)
_SAMPLING, _TEST_SAMPLING = f"{_PLANT}/sampling/sampling.py", "tests/unit/plant/test_sampling.py"
_ENCLOSURE = "phalanx/theory/margins/enclosure.py"
_TEST_ENCLOSURE = "tests/unit/theory/margins/test_enclosure.py"
_INTEGRATED = "phalanx/theory/margins/integrated.py"
_TEST_INTEGRATED = "tests/unit/theory/margins/test_integrated.py"
_TEST_MARGIN = "tests/unit/theory/margins/test_row_margins.py"
_VERIFY, _TEST_VERIFY = "phalanx/launcher/verify.py", "tests/unit/launcher/test_verify.py"
_COORDINATOR = "phalanx/studies/coordinator.py"
_TEST_COORDINATOR = "tests/unit/studies/test_coordinator.py"
_TEST_SECRETS = "tests/process/viewer/test_secrets.py"
_PROOFS, _TEST_PROOFS = (
    "phalanx/guarantee/proven_filter.py",
    "tests/unit/guarantee/test_proven_filter.py",
)

MUTANTS = (
    Mutant("any t_apply", _ANSWERS, "message.t_apply != sample.t + self._latency", "False",
           _TEST_ANSWERS),
    Mutant("an input outside U", _ANSWERS,
           "not self._actuators.takes(i, x, u)", "False", _TEST_ANSWERS),
    Mutant("an answer twice", _ANSWERS, "else self._answered)[i]",
           "else defaultdict(lambda: -1))[i]", _TEST_ANSWERS),
    Mutant("an answer to another sample", _ANSWERS, " and (reports or message.k == newest)", "",
           _TEST_ANSWERS),
    Mutant("an input of another size", _ANSWERS, "len(message.u) != self._sizes[i]", "False",
           _TEST_ANSWERS),
    Mutant("a report twice", _ANSWERS, "(self._reported if reports",
           "(defaultdict(lambda: -1) if reports", _TEST_ANSWERS),
    Mutant("a fate of no agent's broadcast", _ANSWERS,
           "not all(self._is_possible(fate) for fate in message.fates)", "False", _TEST_ANSWERS),
    Mutant("a command twice", f"{_PLANT}/clock/commands.py",
           "message.number <= self._latest", "False", "tests/unit/plant/test_commands.py"),
    Mutant("a command for no agent", f"{_PLANT}/clock/commands.py",
           "refusal(message.command, self._names)", "None", "tests/unit/plant/test_commands.py"),
    Mutant("more payloads than may wait", f"{_PLANT}/hub/session.py", ">= 2 * _MOST else None",
           ">= 10**9 else None", "tests/unit/plant/test_incoming.py"),
    Mutant("another scenario's agent", f"{_PLANT}/hub/hub.py",
           "alive and digest != self.digest", "False", "tests/unit/plant/test_joining.py"),
    Mutant("a sample skipped", _STEP, "skipped and not first and clock.waits", "False",
           _TEST_STEP),
    Mutant("a sample twice", _STEP, "if skipped < 0 or", "if", _TEST_STEP),
    Mutant("states that no world has", _STEP, "not largest <= LARGEST", "False", _TEST_STEP),
    Mutant("broadcasts of the far future", _STEP, "message.k >= broadcaster.most", "False",
           _TEST_STEP),
    Mutant("a broadcast of another size", _STEP,
           "len(message.u) != broadcaster.inputs", "False", _TEST_STEP),
    Mutant("a broadcast twice", "phalanx/network/inbox.py",
           "k <= incoming.decided or k in incoming.arrived", "False", _TEST_LINKS),
    Mutant("a delay from t instead of t_apply", "phalanx/network/inbox.py",
           "in_flight.append((sent + copy.after, sender, message))",
           "in_flight.append((t + copy.after, sender, message))",
           _TEST_LINKS),
    Mutant("broadcasts heard too early", "phalanx/network/inbox.py", "if at <= t]",
           "if True]", _TEST_LINKS),
    Mutant("any seal", _SEAL, "mac != self._mac(key, body)", "False", _TEST_SEAL),
    Mutant("a seal of another key", _SEAL, "hashlib.blake2b(key.encode(), key=",
           'hashlib.blake2b(b"", key=', _TEST_SEAL),
    Mutant("numbers that are none", _SEAL, "not abs(n) <= message.largest",
           "abs(n) > message.largest", _TEST_SEAL),
    Mutant("another version", _SEAL, "message.version != VERSION", "False", _TEST_SEAL),
    Mutant("wildcards in a key", "phalanx/messages/keys.py", ' or "*" in key', "",
           "tests/unit/messages"),
    Mutant("records of another scenario", "phalanx/recording/read.py", "if unfit :=",
           "if unfit := None and",  _TEST_RECORDING),
    Mutant("frames of another size", "viewer/phalanx_viewer/feeds/live.py",
           "len(frame.x) != 8 * states or len(frame.agents) != len(members)", "False",
           "tests/unit/hostile/test_messages.py"),
    Mutant("a result without a hub", f"{_PLANT}/main.py", "_send_result(launcher, summary)",
           "pass", "tests/process/swarm/test_endings.py -k disk_that_fills"),
    Mutant("all agents' broadcasts", _ACCESS, 'keys.broadcast("*", n)))',
           'keys.broadcast("*", "*")))', _TEST_ACCESS),
    Mutant("a viewer's identity for an operator's", _ACCESS, 'subject == "usernames", OP',
           "True, OP", _TEST_ACCESS),
    Mutant("a plant that comes in", _ACCESS, "with_plant: bool = False",
           "with_plant: bool = True", _TEST_ACCESS),
    Mutant("live.json for all", "phalanx/launcher/live.py", "os.O_EXCL, 0o600",
           "os.O_EXCL, 0o644", "tests/unit/launcher/test_live.py"),
    Mutant("logs for all", "phalanx/launcher/programs.py", "os.O_APPEND, 0o600",
           "os.O_APPEND, 0o644", _TEST_SECRETS),
    Mutant("a token in a log", "viewer/phalanx_viewer/pages.py", "trust=True, announce=silent,",
           "trust=True,", _TEST_SECRETS),
    Mutant("a wrong token of a page", "viewer/phalanx_viewer/page/page.py",
           "if hmac.compare_digest(", "if True or hmac.compare_digest(",
           "tests/process/viewer/test_visitors.py -k token"),
    Mutant("a world's robots anywhere", "phalanx/cli/run.py",
           'getattr(resolved.fresh_world(), "router", None)', "None",
           "tests/unit/cli/test_refused.py -k router"),
    Mutant("a row too large is dropped", "phalanx/theory/rows/qp.py", "not finite.all()", "False",
           "tests/unit/theory/rows/test_decide_pairs.py"),
    Mutant("keys for all", "phalanx/hosts/authority.py", "os.O_EXCL, 0o600",
           "os.O_EXCL, 0o644", "tests/unit/hosts/test_authority.py"),
    Mutant("an agent's identity for a hub", "phalanx/hosts/authority.py",
           "hub_hosts if name in HUBS else ()", "hub_hosts",
           "tests/process/hostile/test_identities.py -k play_the_hub"),
    Mutant("a hub of any name", "phalanx/messages/credentials.py", '"verify_name_on_connect": True',
           '"verify_name_on_connect": False',
           "tests/process/hostile/test_identities.py -k another_name"),
    Mutant("near pairs for three times the slack", _PAIRS, "<= self._room * self._room",
           "<= 9.0 * self._room * self._room", _TEST_PAIRS),
    Mutant("near pairs by the highest level of several states", _PAIRS, "self._least(h).min():",
           "self._least(h).max():", _TEST_PAIRS),
    Mutant("boxes as old as they like", _BOXES, "if t > self._until:", "if self._until < 0.0:",
           _TEST_BOXES),
    Mutant("boxes that forget how long they are kept", _BOXES,
           "MULTIPLES[0] * tau + self._lasting", "MULTIPLES[0] * tau", _TEST_BOXES),
    Mutant("boxes of the shortest period", _BOXES, "tau = swarm.longest_horizon",
           "tau = min(map(swarm.horizon, swarm.normal))", _TEST_BOXES),
    Mutant("boxes that are not certain", _BOXES, "ca.if_else(reach.certain, p_k.lo, -ca.inf)",
           "p_k.lo", _TEST_BOXES),
    Mutant("boxes that are not certain, to the other side", _BOXES,
           "ca.if_else(reach.certain, p_k.hi, ca.inf)", "p_k.hi", _TEST_BOXES),
    Mutant("boxes without disturbance", _BOXES, "int(agents[0]), bound, horizon",
           "int(agents[0]), 0.0, horizon", _TEST_BOXES),
    Mutant("obstacles as large as agents", _BOXES, "static_reach(function, 0.0, obstacle)",
           "function.reach(0.0)", _TEST_BOXES),
    Mutant("who may meet within the shortest certificate only",
           "phalanx/guarantee/certificates.py",
           "longest = MULTIPLES[0] * tau", "longest = MULTIPLES[-1] * tau", _TEST_BOXES),
    Mutant("another group's certificates", "phalanx/swarm/swarm.py",
           "groups[pairs], ", "", _TEST_BOXES),
    Mutant("a start that is left at once", _ASSUMED, "steps.h[0] <= 0.0", "steps.h[-1] <= 0.0",
           _TEST_JUDGE),
    Mutant("a start with an unsafe pair", _ASSUMED, "(steps.h[0] <= 0.0).all()",
           "(steps.h[0] <= 0.0).any()", _TEST_JUDGE),
    Mutant("an h_tot that is no number", _JUDGE, "np.logical_and.reduce(finite)",
           "np.logical_or.reduce(finite)", _TEST_JUDGE),
    Mutant("what actuators hold at first", _ASSUMED, "if event.t > 0.0:", "if False:",
           _TEST_JUDGE),
    Mutant("an input that is lost", _ASSUMED, "self._prompt.check(False, event.t_due)", "pass",
           _TEST_JUDGE),
    Mutant("a pair without a certificate", _COVERAGE, "int(ends.argmin())",
           "int(ends.argmax())", _TEST_JUDGE),
    Mutant("a certificate of no time", _COVERAGE, "proven > 0.0", "proven >= 0.0", _TEST_JUDGE),
    Mutant("certificates of pairs set apart", _COVERAGE,
           "np.where(self._excluded, np.inf, self.ends)", "self.ends", _TEST_JUDGE),
    Mutant("an unresolved motion", _ASSUMED, "(self._resolved, self._prompt) if",
           "(self._prompt,) if",
           _TEST_JUDGE),
    Mutant("a theorem without a disturbance bound", _ASSUMED,
           "[self._start_kept, self._gap, self._disturbance]", "[self._start_kept, self._gap]",
           _TEST_JUDGE),
    Mutant("a theorem that believes broadcasts", _ASSUMED,
           "self._fresh, self._claims.truthful]", "self._fresh]", _TEST_JUDGE),
    Mutant("a lie whose time is right", _ASSUMED,
           "held and not self._claims.misled(event.i, other, t - age)", "held", _TEST_JUDGE),
    Mutant("what an adversary says of others", _JUDGE,
           "i in self._swarm.normal and i not in self._turned", "True", _TEST_JUDGE),
    Mutant("what each of many steps rounds away", f"{_PLANT}/world/resolution.py",
           "(total - (total - errors)[first])", "errors", "tests/unit/plant/test_resolution.py"),
    Mutant("dynamics that are equal but move otherwise", "phalanx/theory/safety/kinds.py",
           "(text, tuple(m.dynamics.states)", "(type(m.dynamics), tuple(m.dynamics.states)",
           "tests/unit/theory/safety/test_pairs_by_kind.py"),
    Mutant("a gap that lasts to the end", _ASSUMED, "if event.t >= self._swarm.scenario.duration:",
           "if False:", _TEST_JUDGE),
    Mutant("a late first sample", _ASSUMED, "and t > 0.0:", "and i in self._sampled:",
           _TEST_JUDGE),
    Mutant("who may go any distance", _LOOKAHEAD, "            return True",
           "            return False", _TEST_LOOKAHEAD),
    Mutant("where an awaited agent is", _LOOKAHEAD, "if j in self._unknown:", "if False:",
           _TEST_LOOKAHEAD),
    Mutant("the worst pair", _EXTREMES, "if h > self.worst_h:", "if h_tot > self.worst_h:",
           _TEST_EXTREMES),
    Mutant("pairs that do not count", _EXTREMES, "if not self._is_excluded[pair]}",
           "if True}", _TEST_EXTREMES),
    Mutant("one of several in sight", _SENSING, "self._reach[i]).any()", "self._reach[i]).all()",
           _TEST_SENSING),
    Mutant("a radius where others see everything", _SENSING, "np.isfinite(self._reach).any()",
           "np.isfinite(self._reach).all()", _TEST_SENSING),
    Mutant("an input at the next sample's instant", _SCHEDULE, "due + late >= self",
           "due + late > self", _TEST_ONBOARD),
    Mutant("who goes on before its last input took effect", _SCHEDULE,
           "math.nextafter(self._due.get(i, -math.inf), math.inf)", "t", _TEST_ONBOARD),
    Mutant("what is on its way when a contact begins", "phalanx/network/inbox.py",
           "self._forget(sender)\n                incoming.begin", "incoming.begin",
           _TEST_LINKS),
    Mutant("the dead as hearers", _SAMPLING, "visible.without(self.silent)", "visible",
           _TEST_SAMPLING),
    Mutant("what the dead had received", _SAMPLING, "forgotten = self._contacts.forget(i)", "pass",
           _TEST_SAMPLING),
    Mutant("a box no wider than its start", _ENCLOSURE, "start.hi < b.hi)", "start.hi <= b.hi)",
           _TEST_ENCLOSURE),
    Mutant("what is driven as if it were slowed", _ENCLOSURE, "steepness.hi < 0, reciprocal",
           "steepness.hi < 1, reciprocal", _TEST_ENCLOSURE),
    Mutant("others that stand still", _ENCLOSURE, "[*box[:k], start, *box[k + 1 :]]",
           "[*map(point, ca.vertsplit(x)), *box[x.numel() :]]", _TEST_ENCLOSURE),
    Mutant("the slope of what jumps", _ENCLOSURE, ", continuous([rate[k]], symbols, box))",
           ", ca.SX(1))", _TEST_ENCLOSURE),
    Mutant("corners rounded inwards", _ENCLOSURE, "1.0 + 1e-6 if rounds", "1.0 - 1e-6 if rounds",
           _TEST_ENCLOSURE),
    Mutant("a speed in place of its square", _INTEGRATED, "ca.fmax(0, speed * speed - 2",
           "ca.fmax(0, speed - 2", _TEST_INTEGRATED),
    Mutant("a third of the gap", _INTEGRATED, "lasting = 0.5 * row.horizon",
           "lasting = row.horizon / 3.0", _TEST_MARGIN),
    Mutant("what actuators take beyond U", _INTEGRATED, "* bound.bend + outside", "* bound.bend",
           _TEST_MARGIN),
    Mutant("a recording of nothing", _VERIFY, "if not recorded.states and not recorded.step_data:",
           "if False:", _TEST_VERIFY),
    Mutant("another seed", _VERIFY, "{} if seed is None else", "{} if True else", _TEST_VERIFY),
    Mutant("half a chunk", "phalanx/recording/write.py", "os.ftruncate(self._fd, self._end)",
           "pass", _TEST_RECORDING),
    Mutant("a dead worker's runs given up at once", "phalanx/studies/work.py",
           "if attempt < task.attempts:", "if False:", _TEST_COORDINATOR),
    Mutant("another trajectory called confirmed", _COORDINATOR,
           "same = again.trajectory == row.trajectory", "same = True", _TEST_COORDINATOR),
    Mutant("a violated run not repeated", _COORDINATOR,
           "if row.outcome in _SURPRISING and", "if False and", _TEST_COORDINATOR),
    Mutant("every violated run repeated", _COORDINATOR, "_MOST_SURPRISES = 20",
           "_MOST_SURPRISES = 1000", _TEST_COORDINATOR),
    Mutant("seeds beyond the width", _COORDINATOR,
           "if not refusal and state.narrow(self._plan.until_width):",
           "if False:", _TEST_COORDINATOR),
    Mutant("a broken run used again", _COORDINATOR,
           "if outcome != BROKEN and identity.scenario:", "if identity.scenario:",
           _TEST_COORDINATOR),
    Mutant("rows of other modules", "phalanx/studies/row.py", "return _digest(list(self))",
           "return _digest([*self[:2], *self[3:]])", "tests/unit/studies"),
    Mutant("rows of other versions", "phalanx/studies/row.py", "return _digest(list(self))",
           "return _digest(list(self[:3]))", "tests/unit/studies"),
    Mutant("draws in the order of fields", "phalanx/studies/plan.py",
           'Draws(self.draw_seed, "study", path)', 'Draws(self.draw_seed, "study")',
           "tests/unit/studies/test_plan.py"),
    Mutant("a torn row", "phalanx/studies/store.py", 'text[: text.rfind(b"\\n") + 1]',
           "text", "tests/unit/studies/test_store.py"),
    Mutant("two writers of one folder", "phalanx/studies/store.py",
           "fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)", "pass",
           "tests/unit/studies/test_store.py"),
    Mutant("a searched row counted", "phalanx/studies/row.py", '~pl.col("searched") & ', "",
           "tests/unit/studies/test_groups.py"),
    Mutant("seeds that share what they drew", "phalanx/swarm/runnable.py",
           "(build_swarm(scenario, functions))",
           '(functions.get("swarm", lambda: build_swarm(scenario, functions)))',
           "tests/unit/studies/test_work.py"),
    Mutant("obstacles of an earlier run", "phalanx/theory/safety/pairs.py",
           "= np.concatenate([np.zeros(0), *numbers])",
           '= self.functions.get("numbers", lambda: np.concatenate([np.zeros(0), *numbers]))',
           "tests/unit/studies/test_work.py"),
    Mutant("pairs that are quiet until they may meet", _PROOFS,
           "swarm.horizon(i)", "0.0", _TEST_PROOFS),
    Mutant("a proof for half a sample", _PROOFS, "times < self._certificates.tau",
           "times < 0.5 * self._certificates.tau", _TEST_PROOFS),
    Mutant("broadcasts delivered in the order of counting", "phalanx/network/inbox.py",
           "due.sort(key=_SENDER)", "pass", _TEST_LINKS),
    Mutant("a link to a folder followed", "phalanx/files/__init__.py",
           "if path.is_symlink():", "if False:", "tests/unit/files"),
    Mutant("a link to a file followed", "phalanx/files/__init__.py",
           "part.replace(path)", "path.write_bytes(part.read_bytes())", "tests/unit/files"),
    Mutant("a recording in no order of time", "phalanx/recording/read.py",
           "if value.t < (t := newest.setdefault(of, value.t)):", "if False:",
           "tests/unit/recording/test_recording.py"),
)  # fmt: skip


def broken(mutant: Mutant) -> str:
    """The file's text with the safeguard broken. Raises LookupError: what is replaced is gone."""
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    if text.count(mutant.old) != 1:
        raise LookupError(f"{mutant.file}: expected once: {mutant.old}")
    return text.replace(mutant.old, mutant.new)
