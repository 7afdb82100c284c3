"""Lies, as a scenario declares them: what each makes of the truth, for whom, and when."""

import pytest

from phalanx.faults.lies import Lies, Told
from phalanx.network.inbox import Claim
from phalanx.scenario.load import load

TRUTH = Claim(0.5, (1.5, -0.5))


def lies(*tables: dict[str, object], agent: str = "2", seed: int = 0) -> Lies:
    """Agent 2's in Simulation 1."""
    faults = [{"kind": "lie", "agent": "2", "for": 1.0, **table} for table in tables]
    return load("unicycles", {"faults": faults}, seed=seed).links().lies(agent)


def told(liar: Lies, receiver: str = "1", k: int = 50, truth: Claim = TRUTH) -> Told:
    """With what it applied n steps ago being (n, n)."""
    return liar.tell(receiver, k, truth, lambda ago: (float(ago), float(ago)))


@pytest.mark.parametrize(
    ("lie", "claim"),
    [
        ({"says": "opposite"}, Claim(0.5, (-1.5, 0.5))),
        ({"says": "zero"}, Claim(0.5, (0.0, 0.0))),
        ({"says": [4.0, 2.0]}, Claim(0.5, (4.0, 2.0))),
        ({"replay": 7}, Claim(0.5, (7.0, 7.0))),
        ({"apply_time": 0.25}, Claim(0.75, (1.5, -0.5))),
        ({"silent": True}, TRUTH),  # its links say nothing instead
    ],
)
def test_a_lie_says_something_else_than_the_truth(lie, claim):
    assert told(lies(lie)) == Told(claim, () if claim == TRUTH else (0,))
    assert told(lies(lie, agent="1")) == Told(TRUTH, ()), "and nobody else lies"


@pytest.mark.parametrize("t", [0.19, 0.5])
def test_before_and_after_its_time_the_truth_is_told(t: float):
    liar = lies({"says": "zero", "at": 0.2, "for": 0.3})
    assert told(liar, truth=Claim(t, (1.0, 1.0))).lies == ()
    assert told(liar, truth=Claim(0.2, (1.0, 1.0))).lies == (0,)


def test_who_is_not_lied_to_hears_the_truth():
    liar = lies({"says": "zero", "to": ["1"]})
    assert told(liar, "1").claim.u == (0.0, 0.0)
    assert told(liar, "3").claim == TRUTH


def test_an_equivocator_tells_every_peer_and_every_step_something_else_within_its_input():
    liar = lies({"equivocate": True})
    claims = [told(liar, peer, k).claim for peer in "13" for k in range(200)]
    assert len(set(claims)) == len(claims)
    for component in (0, 1):
        shares = [claim.u[component] / TRUTH.u[component] for claim in claims]
        assert -1.0 <= min(shares) < -0.9
        assert 0.9 < max(shares) <= 1.0
    assert told(liar, "1", 3) == told(lies({"equivocate": True}), "1", 3), "a pure function"
    assert told(liar, "1", 3) != told(lies({"equivocate": True}, seed=1), "1", 3)


def test_a_lie_that_happens_to_be_true_has_no_effect():
    assert told(lies({"says": "opposite"}), truth=Claim(0.5, (0.0, 0.0))).lies == ()


def test_lies_that_are_told_at_once_are_made_of_each_other_and_all_counted():
    both = told(lies({"says": "opposite"}, {"apply_time": -0.1}, {"silent": True}))
    assert both == Told(Claim(0.4, (-1.5, 0.5)), (0, 1))


def test_a_silent_liar_says_nothing_on_its_links_alone():
    silent = {"kind": "lie", "agent": "2", "to": ["1"], "at": 0.2, "for": 0.3, "silent": True}
    links = load("unicycles", {"faults": [silent]}).links()
    assert links.declared == ("faults.0 (lie)",)
    cut = {link for link in ("21", "23", "12") if links.model(*link).stages}
    assert cut == {"21"}
