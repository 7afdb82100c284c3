"""The broadcasts that exist for agent 0, which listens to agent 1, by virtual time alone."""

import numpy as np
import pytest
from phalanx_plant.sampling.sensing import Contacts, Visibility

PERIOD = 0.01
APART, IN_SIGHT = Visibility((1,), ()), Visibility((0, 1), (0,))
"""Agent 1's visibility: agent 0 is far away, or in sight."""


class Pair:
    """Agent 1 samples at 0, Γ, 2Γ ...; agent 0 in the middle between, and sees it or not."""

    def __init__(self, latency: float = 0.0) -> None:
        self.contacts = Contacts(2, latency)
        self.k = self.samples = 0

    def speaks(self, visible: Visibility = IN_SIGHT) -> None:
        """Agent 1 takes its next sample, and broadcasts."""
        self.contacts.sampled(1, self.k, PERIOD * self.k, visible, True)
        self.k += 1

    def hears(self, sees: bool = True, later: float = 0.0) -> tuple[int, int] | None:
        """Agent 0 takes a sample: first and last of agent 1's broadcasts that exist."""
        self.samples += 1
        t = PERIOD * (self.k - 0.5) + later + 1e-6 * self.samples
        visible = (0, 1) if sees else (0,)
        existing = self.contacts.existing(0, t, visible)
        self.contacts.sampled(0, self.samples, t, Visibility(visible, ()), True)
        assert [sender for sender, _, _ in existing] in ([], [1]), "none receives from itself"
        return existing[0][1:] if existing else None


def test_among_agents_in_sight_of_each_other_every_broadcast_counts_from_the_first_on():
    pair = Pair()
    for k in range(5):
        pair.speaks()
        assert pair.hears() == (0, k)


def test_agents_that_sample_together_do_not_hear_each_other():
    contacts = Contacts(2, 0.0)
    both = (0, 1)
    for k in range(4):
        existing = [contacts.existing(i, PERIOD * k, both) for i in both]
        assert existing == ([[(1, 0, k - 1)], [(0, 0, k - 1)]] if k else [[], []])
        for i in both:
            contacts.sampled(i, k, PERIOD * k, Visibility(both, (1 - i,)), True)


def test_a_broadcast_sent_at_the_very_instant_of_a_sample_is_not_heard_in_it():
    contacts = Contacts(2, 0.0)
    for k, t in enumerate((0.0, PERIOD)):
        contacts.sampled(1, k, t, IN_SIGHT, True)
    assert contacts.existing(0, PERIOD, (1,)) == [(1, 0, 0)]
    assert contacts.existing(0, np.nextafter(PERIOD, 1.0), (1,)) == [(1, 0, 1)]


def test_only_broadcasts_sent_after_an_agent_came_into_range_count():
    pair = Pair()
    pair.speaks(APART)
    pair.speaks(APART)
    assert pair.hears(sees=False) is None
    assert pair.hears() is None, "in sight, but nothing was sent since"
    pair.speaks()
    assert pair.hears() == (2, 2)


def test_an_agent_that_leaves_and_comes_back_begins_a_new_contact():
    pair = Pair()
    pair.speaks()
    assert pair.hears() == (0, 0)
    assert pair.hears(sees=False) is None
    assert pair.hears() is None, "the input of before may long be another"
    pair.speaks()
    assert pair.hears() == (1, 1)


def test_a_broadcast_that_went_out_unheard_ends_the_contact_even_between_two_samples():
    pair = Pair()
    pair.speaks()
    assert pair.hears() == (0, 0)
    pair.speaks(APART)
    assert pair.hears() is None, "it sees agent 1 again, but not what that holds now"
    pair.speaks()
    pair.speaks()
    assert pair.hears() == (2, 3)


@pytest.mark.parametrize(("later", "latest"), [(-0.002, 0), (0.002, 1)])
def test_a_broadcast_exists_once_its_input_takes_effect(later, latest):
    pair = Pair(latency=0.5 * PERIOD)
    pair.speaks()
    pair.speaks()
    assert pair.hears(later=later) == (0, latest)


def test_adversaries_are_seen_but_never_heard():
    contacts = Contacts(2, 0.0)
    contacts.sampled(1, 0, 0.0, Visibility((0, 1), ()), True)
    assert contacts.existing(0, PERIOD, (0, 1)) == []
