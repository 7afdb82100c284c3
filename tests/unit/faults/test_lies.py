"""Declared lies: the claims they make instead of the truth, their receivers and times."""

import pytest

from phalanx.faults.lies import Lies, PeerClaim
from phalanx.network.inbox import AnnouncedInput
from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError

TRUTH = AnnouncedInput(0.5, (1.5, -0.5))


def lies(*tables: dict[str, object], agent: str = "2", seed: int = 0) -> Lies:
    """Return the declared lies of an agent in Simulation 1."""
    faults = [{"kind": "lie", "agent": "2", "for": 1.0, **table} for table in tables]
    return load("unicycles", {"faults": faults}, seed=seed).links().lies(agent)


def claimed(
    liar: Lies, receiver: str = "1", k: int = 50, truth: AnnouncedInput = TRUTH
) -> PeerClaim:
    """Return the claim to a peer at 0.5 s; the input of n steps ago was (n, n), its state n."""
    past = lambda ago: AnnouncedInput(0.5, (float(ago),) * 2, (float(ago),) * len(truth.x))  # noqa: E731
    return liar.claim(receiver, k, truth, past, 0.5)


@pytest.mark.parametrize(
    ("lie", "claim"),
    [
        ({"says": "opposite"}, AnnouncedInput(0.5, (-1.5, 0.5))),
        ({"says": "zero"}, AnnouncedInput(0.5, (0.0, 0.0))),
        ({"says": [4.0, 2.0]}, AnnouncedInput(0.5, (4.0, 2.0))),
        ({"replay": 7}, AnnouncedInput(0.5, (7.0, 7.0))),
        ({"apply_time": 0.25}, AnnouncedInput(0.75, (1.5, -0.5))),
        ({"silent": True}, TRUTH),  # its links are cut instead
    ],
)
def test_a_lie_changes_the_claim(lie, claim):
    assert claimed(lies(lie)) == PeerClaim(claim, () if claim == TRUTH else (0,))
    assert claimed(lies(lie, agent="1")) == PeerClaim(TRUTH, ()), "other agents do not lie"


@pytest.mark.parametrize(
    ("lie", "x"),
    [
        ({"shift": [2.0, -1.0, 0.5]}, (3.0, 0.0, 1.5)),
        ({"drift": [2.0, 0.0, 0.0], "at": 0.25}, (1.5, 1.0, 1.0)),
        ({"replay": 7}, (7.0, 7.0, 7.0)),
        ({"says": "zero"}, (1.0, 1.0, 1.0)),
    ],
)
def test_by_radio_a_lie_changes_the_state_too(lie, x):
    truth = AnnouncedInput(0.5, TRUTH.u, (1.0, 1.0, 1.0))
    assert claimed(lies(lie), truth=truth).claim.x == x
    assert claimed(lies(lie)).claim.x == (), "without a radio no state is stated"


def test_as_much_of_the_past_is_there_as_the_longest_replay_needs():
    three = {"replay": 2}, {"says": "zero"}, {"replay": 5}
    assert [lies(*three, agent=name).steps_back for name in "12"] == [0, 5]


@pytest.mark.parametrize("field", ["shift", "drift"])
def test_a_false_state_has_as_many_components_as_the_true_one(field):
    with pytest.raises(ScenarioError, match=f"faults.0.{field}: expected 3 components"):
        lies({field: [1.0, 0.0]})


@pytest.mark.parametrize("t", [0.19, 0.5])
def test_before_and_after_its_time_the_claim_is_true(t: float):
    liar = lies({"says": "zero", "at": 0.2, "for": 0.3})
    assert claimed(liar, truth=AnnouncedInput(t, (1.0, 1.0))).lies == ()
    assert claimed(liar, truth=AnnouncedInput(0.2, (1.0, 1.0))).lies == (0,)


def test_other_peers_receive_the_truth():
    liar = lies({"says": "zero", "to": ["1"]})
    assert claimed(liar, "1").claim.u == (0.0, 0.0)
    assert claimed(liar, "3").claim == TRUTH


def test_an_equivocator_claims_another_input_to_every_peer_at_every_step():
    liar = lies({"equivocate": True})
    claims = [claimed(liar, peer, k).claim for peer in "13" for k in range(200)]
    assert len(set(claims)) == len(claims)
    for component in (0, 1):
        shares = [claim.u[component] / TRUTH.u[component] for claim in claims]
        assert -1.0 <= min(shares) < -0.9
        assert 0.9 < max(shares) <= 1.0
    assert claimed(liar, "1", 3) == claimed(lies({"equivocate": True}), "1", 3), "a pure function"
    assert claimed(liar, "1", 3) != claimed(lies({"equivocate": True}, seed=1), "1", 3)


def test_a_lie_that_happens_to_be_true_has_no_effect():
    assert claimed(lies({"says": "opposite"}), truth=AnnouncedInput(0.5, (0.0, 0.0))).lies == ()


def test_simultaneous_lies_are_applied_in_order_and_all_counted():
    both = claimed(lies({"says": "opposite"}, {"apply_time": -0.1}, {"silent": True}))
    assert both == PeerClaim(AnnouncedInput(0.4, (-1.5, 0.5)), (0, 1))


def test_a_silent_liar_is_cut_from_its_receivers_alone():
    silent = {"kind": "lie", "agent": "2", "to": ["1"], "at": 0.2, "for": 0.3, "silent": True}
    links = load("unicycles", {"faults": [silent]}).links()
    assert links.declared == ("faults.0 (lie)",)
    cut = {link for link in ("21", "23", "12") if links.model(*link).stages}
    assert cut == {"21"}
