"""Safeguards that no drawn mutant breaks, broken by hand: some test must fail for each.

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
_JUDGE, _TEST_JUDGE = f"{_PLANT}/judge/judge.py", "tests/unit/plant/test_judge.py"
_PAIRS, _TEST_PAIRS = f"{_PLANT}/world/evaluation.py", "tests/unit/plant/test_relevant_pairs.py"
_BOXES, _TEST_BOXES = "phalanx/guarantee/reachable.py", "tests/unit/guarantee/test_reachable.py"
_ACCESS, _TEST_ACCESS = "phalanx/messages/admission.py", "tests/unit/identities/test_access.py"
_ASSUMED, _COVERAGE = f"{_PLANT}/judge/assumptions.py", f"{_PLANT}/judge/coverage.py"
_EXTREMES, _TEST_EXTREMES = f"{_PLANT}/world/extremes.py", "tests/unit/plant/test_extremes.py"
_SCHEDULE, _TEST_ONBOARD = (
    f"{_PLANT}/sampling/sampling.py",
    "tests/unit/plant/test_onboard_links.py",
)
_SAMPLING, _TEST_SAMPLING = f"{_PLANT}/sampling/sampling.py", "tests/unit/plant/test_sampling.py"
_POINT = "phalanx/theory/rows/nearest_point.py"
_TEST_POINT = "tests/unit/theory/rows/test_nearest_point.py"
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
_KNOWLEDGE, _TEST_KNOWLEDGE = "phalanx/knowledge", "tests/unit/knowledge"

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
           "not self._well_formed(broadcaster, message)", "False", _TEST_STEP),
    Mutant("a delay from t instead of t_apply", "phalanx/network/inbox.py",
           "in_flight.append((sent + copy.after, sender, message))",
           "in_flight.append((t + copy.after, sender, message))",
           _TEST_LINKS),
    Mutant("a seal of another key", _SEAL, "hashlib.blake2b(key.encode(), key=",
           'hashlib.blake2b(b"", key=', _TEST_SEAL),
    Mutant("numbers that are none", _SEAL, "not abs(n) <= message.largest",
           "abs(n) > message.largest", _TEST_SEAL),
    Mutant("wildcards in a key", "phalanx/messages/keys.py", ' or "*" in key', "",
           "tests/unit/messages"),
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
    Mutant("a row too large is dropped", "phalanx/theory/rows/qp.py",
           "not ((sizes < np.inf) & (g > -INFINITY)).all()", "False",
           "tests/unit/theory/rows/test_decide_pairs.py"),
    Mutant("an input to be proven may lie on its row", "phalanx/guarantee/proven_filter.py",
           "_INSIDE = 1e-6", "_INSIDE = 0.0", "tests/unit/guarantee/test_proven_filter.py"),
    Mutant("of equal backups the first found is taken", "phalanx/theory/rows/least_violation.py",
           "key=lambda x: (x[-1], x)", "key=lambda x: x[-1]",
           "tests/unit/theory/rows/test_least_violation.py"),
    Mutant("in a box a row is kept with some to spare", "phalanx/theory/rows/nearest_in_box.py",
           "begin + (end - begin) * (value - bound) / (value - then)", "end",
           "tests/unit/theory/rows/test_nearest_in_box.py"),
    Mutant("a minimiser's multiplier may be negative", _POINT,
           "default=0.0) < -DUAL", "default=0.0) < -1e9 * DUAL", _TEST_POINT),
    Mutant("a minimiser keeps its rows only roughly", _POINT,
           "PRIMAL = 1e-9", "PRIMAL = 1e-5", _TEST_POINT),
    Mutant("sets of rows are tried from the largest", _POINT,
           "combinations(rows, size) for size in range(m + 1)",
           "combinations(rows, size) for size in reversed(range(m + 1))", _TEST_POINT),
    Mutant("a row is not looked at", _POINT,
           "excess = _products(G, v) - g - tolerance",
           "excess = (_products(G, v) - g - tolerance)[:-1]", _TEST_POINT),
    Mutant("a hint with other rows close to it ends the search", _POINT,
           "return len(_near(optimum)) == len(rows) and", "return", _TEST_POINT),
    Mutant("a hint with a multiplier of nearly zero ends the search", _POINT,
           "min(optimum.multipliers, default=inf) > least", "True", _TEST_POINT),
    Mutant("keys for all", "packages/phalanx-hosts/phalanx_hosts/authority.py", "os.O_EXCL, 0o600",
           "os.O_EXCL, 0o644", "packages/phalanx-hosts/tests/test_authority.py"),
    Mutant("an agent's identity for a hub", "packages/phalanx-hosts/phalanx_hosts/authority.py",
           "hub_hosts if name in HUBS else ()", "hub_hosts",
           "tests/process/hostile/test_identities.py -k play_the_hub"),
    Mutant("a hub of any name", "phalanx/messages/credentials.py", '"verify_name_on_connect": True',
           '"verify_name_on_connect": False',
           "tests/process/hostile/test_identities.py -k another_name"),
    Mutant("near pairs for three times the slack", _PAIRS, "<= self._room * self._room",
           "<= 9.0 * self._room * self._room", _TEST_PAIRS),
    Mutant("near pairs by the highest level of several states", _PAIRS, "self._least(h).min():",
           "self._least(h).max():", _TEST_PAIRS),
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
    Mutant("another group's certificates", "phalanx/swarm/swarm.py",
           "groups[pairs], ", "", _TEST_BOXES),
    Mutant("an h_tot that is no number", _JUDGE, "np.logical_and.reduce(finite)",
           "np.logical_or.reduce(finite)", _TEST_JUDGE),
    Mutant("a pair without a certificate", _COVERAGE, "int(ends.argmin())",
           "int(ends.argmax())", _TEST_JUDGE),
    Mutant("certificates of pairs set apart", _COVERAGE,
           "np.where(self._excluded, np.inf, self.ends)", "self.ends", _TEST_JUDGE),
    Mutant("an unresolved motion", _ASSUMED, "(self._resolved, self._prompt) if",
           "(self._prompt,) if",
           _TEST_JUDGE),
    Mutant("a theorem without a disturbance bound", _ASSUMED,
           "[self._start_kept, self._gap, self._disturbance]", "[self._start_kept, self._gap]",
           _TEST_JUDGE),
    Mutant("a theorem that believes broadcasts", _ASSUMED,
           "[self._claims.truthful] if", "[] if", _TEST_JUDGE),
    Mutant("a lie whose time is right", _ASSUMED,
           "held and not self._claims.misled(event.i, other, t - age)", "held", _TEST_JUDGE),
    Mutant("what an adversary says of others", _JUDGE,
           "i in self._swarm.normal and i not in self._turned", "True", _TEST_JUDGE),
    Mutant("what each of many steps rounds away", f"{_PLANT}/world/resolution.py",
           "(total - (total - errors)[first])", "errors", "tests/unit/plant/test_resolution.py"),
    Mutant("dynamics that are equal but move otherwise", "phalanx/theory/safety/kinds.py",
           "(text, tuple(m.dynamics.states)", "(type(m.dynamics), tuple(m.dynamics.states)",
           "tests/unit/theory/safety/test_pairs_by_kind.py"),
    Mutant("a late first sample", _ASSUMED, "and t > 0.0:", "and i in self._sampled:",
           _TEST_JUDGE),
    Mutant("the worst pair", _EXTREMES, "if h > self.worst_h:", "if h_tot > self.worst_h:",
           _TEST_EXTREMES),
    Mutant("pairs that do not count", _EXTREMES, "if not self._is_excluded[pair]}",
           "if True}", _TEST_EXTREMES),
    Mutant("who goes on before its last input took effect", _SCHEDULE,
           "math.nextafter(self._due.get(i, -math.inf), math.inf)", "t", _TEST_ONBOARD),
    Mutant("what is on its way when a contact begins", "phalanx/network/inbox.py",
           "self._forget(sender)\n                incoming.begin", "incoming.begin",
           _TEST_LINKS),
    Mutant("the dead as hearers", _SAMPLING, "visible.without(self.silent)", "visible",
           _TEST_SAMPLING),
    Mutant("what the dead had received", _SAMPLING, "forgotten = self._contacts.forget(i)", "pass",
           _TEST_SAMPLING),
    Mutant("others that stand still", _ENCLOSURE, "[*box[:k], start, *box[k + 1 :]]",
           "[*map(point, ca.vertsplit(x)), *box[x.numel() :]]", _TEST_ENCLOSURE),
    Mutant("the slope of what jumps", _ENCLOSURE, ", continuous([rate[k]], symbols, box))",
           ", ca.SX(1))", _TEST_ENCLOSURE),
    Mutant("a speed in place of its square", _INTEGRATED, "ca.fmax(0, speed * speed - 2",
           "ca.fmax(0, speed - 2", _TEST_INTEGRATED),
    Mutant("a third of the gap", _INTEGRATED, "lasting = 0.5 * row.horizon",
           "lasting = row.horizon / 3.0", _TEST_MARGIN),
    Mutant("what actuators take beyond U", _INTEGRATED, "* bound.bend + outside", "* bound.bend",
           _TEST_MARGIN),
    Mutant("another seed", _VERIFY, "{} if seed is None else", "{} if True else", _TEST_VERIFY),
    Mutant("a broken run used again", _COORDINATOR,
           "newest == identity and outcome != BROKEN", "newest == identity", _TEST_COORDINATOR),
    Mutant("rows of other modules", _COORDINATOR, "newest == identity and",
           "newest and newest[:2] == identity[:2] and", _TEST_COORDINATOR),
    Mutant("draws in the order of fields", "phalanx/studies/plan.py",
           'Draws(self.draw_seed, "study", path)', 'Draws(self.draw_seed, "study")',
           "tests/unit/studies/test_plan.py"),
    Mutant("a torn row", "phalanx/studies/store.py", 'text[: text.rfind(b"\\n") + 1]',
           "text", "tests/unit/studies/test_store.py"),
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
    Mutant("a link to a folder followed", "phalanx/files/__init__.py",
           "if path.is_symlink():", "if False:", "tests/unit/files"),
    Mutant("a link to a file followed", "phalanx/files/__init__.py",
           "part.replace(path)", "path.write_bytes(part.read_bytes())", "tests/unit/files"),
    Mutant("a set without growth by the input", f"{_KNOWLEDGE}/sets.py",
           "after(rest, motions, -bound, bound)", "after(rest, motions, -0.9 * bound, bound)",
           f"{_TEST_KNOWLEDGE}/test_sets.py"),
    Mutant("a stamp taken for exact", f"{_KNOWLEDGE}/sets.py",
           "    if stamp_error > 0.0:\n", "    if False:\n", f"{_TEST_KNOWLEDGE}/test_sets.py"),
    Mutant("a peer that stands still during the hold", f"{_KNOWLEDGE}/cones.py",
           "+ motions.authority + own.drag", "+ own.drag", f"{_TEST_KNOWLEDGE}/test_spending.py"),
    Mutant("cones as of the begin of a piece", f"{_KNOWLEDGE}/cones.py",
           "0.5 * end * end)", "0.5 * begin * begin)", f"{_TEST_KNOWLEDGE}/test_spending.py"),
    Mutant("an own part at the begin of a piece", f"{_KNOWLEDGE}/spending.py",
           "motion.longest * faster)[:, 1:]", "motion.longest * faster)[:, :-1]",
           f"{_TEST_KNOWLEDGE}/test_spending.py"),
    Mutant("a quotient near rest", f"{_KNOWLEDGE}/spending.py",
           "np.maximum(faster, -c_size)", "faster", f"{_TEST_KNOWLEDGE}/test_spending.py"),
    Mutant("closing in at one end of a piece", f"{_KNOWLEDGE}/spending.py",
           "[path[:, :-1], path[:, 1:]]", "[path[:, :-1], path[:, :-1]]",
           f"{_TEST_KNOWLEDGE}/test_spending.py"),
    Mutant("a brake in fewer holds", f"{_KNOWLEDGE}/motion.py",
           "count = max(1, ceil(", "count = max(1, int(", f"{_TEST_KNOWLEDGE}/test_spending.py"),
    Mutant("a brake that forgets the drag", f"{_KNOWLEDGE}/motion.py",
           "(factors.decay / factors.speed)", "(1.0 / (count * self.longest))",
           f"{_TEST_KNOWLEDGE}/test_spending.py"),
    Mutant("own spending since a state was heard", f"{_KNOWLEDGE}/shares.py",
           "regained - spent - unsure", "regained - unsure", f"{_TEST_KNOWLEDGE}/test_shares.py"),
    Mutant("a way given back", f"{_KNOWLEDGE}/shares.py",
           "(gap + regained) * rest - regained", "gap * rest", f"{_TEST_KNOWLEDGE}/test_shares.py"),
    Mutant("ways closed in by the own speed at a hold's begin", f"{_KNOWLEDGE}/shares.py",
           "around.closing(path[:, 1:])", "0.0", f"{_TEST_KNOWLEDGE}/test_shares.py"),
    Mutant("a share of what was decided before", f"{_KNOWLEDGE}/shares.py",
           "state.t_apply > state.t", "False", f"{_TEST_KNOWLEDGE}/test_shares.py"),
    Mutant("a share of a start in motion", f"{_KNOWLEDGE}/shares.py",
           "started_moving or", "False or", f"{_TEST_KNOWLEDGE}/test_shares.py"),
    Mutant("memory of a reference that jumped", f"{_KNOWLEDGE}/own_parts.py",
           "self._shares.forget()", "pass", f"{_TEST_KNOWLEDGE}/test_shares.py"),
    Mutant("the last input untested", f"{_KNOWLEDGE}/choice.py",
           "if (excess <= 0.0).all():", "if worst >= 0:", _TEST_KNOWLEDGE),
    Mutant("peers never heard", f"{_KNOWLEDGE}/own_parts.py",
           "if unheard := len(self._names) - heard:", "if unheard := 0:",
           f"{_TEST_KNOWLEDGE}/test_own_parts.py"),
    Mutant("all of the input for the reference", f"{_KNOWLEDGE}/motion.py",
           "self.acceleration - self.reserve", "self.acceleration", _TEST_KNOWLEDGE),
    Mutant("a tube without the gaps between samples", f"{_KNOWLEDGE}/tracking.py",
           "largest = self._growth(times) * radius +", "largest = 0.5 * radius +", _TEST_KNOWLEDGE),
    Mutant("a tube without measured errors", f"{_KNOWLEDGE}/tracking.py",
           " + _reached(factors, twice) * pull", "", f"{_TEST_KNOWLEDGE}/test_tracking.py"),
    Mutant("κ above 1/(e τ)", f"{_KNOWLEDGE}/own_parts.py",
           "min(kappa, 1.0 / (_E * longest))", "kappa", f"{_TEST_KNOWLEDGE}/test_own_parts.py"),
)  # fmt: skip


def broken(mutant: Mutant) -> str:
    """The file's text with the safeguard broken. Raises LookupError: what is replaced is gone."""
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    if text.count(mutant.old) != 1:
        raise LookupError(f"{mutant.file}: expected once: {mutant.old}")
    return text.replace(mutant.old, mutant.new)
