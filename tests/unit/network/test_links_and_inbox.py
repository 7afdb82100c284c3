"""Links and inbox: treatment of broadcasts, and the inputs received by t."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest

from phalanx.messages.kinds import Broadcast
from phalanx.network.inbox import (
    AnnouncedInput,
    BroadcastInbox,
    BroadcastRange,
    DeliveryReport,
    Incoming,
)
from phalanx.network.link import Link
from tests.unit.network.models import broadcast, inbox_of, model

LOSSY = model(loss=0.3, delay={"low": 0.002, "high": 0.05})
MANY = 4000


def fates(link: Link, ks: "range | list[int]" = range(MANY)) -> list[float | None]:
    return [link.fate(k).delay for k in ks]


def test_links_in_each_direction_and_seeds_have_fates_of_their_own():
    sequences = [
        tuple(fates(Link(seed, sender, receiver, LOSSY), range(50)))
        for seed, sender, receiver in [
            (0, "a", "b"),
            (0, "b", "a"),
            (0, "a", "c"),
            (0, "c", "b"),
            (1, "a", "b"),
        ]
    ]
    assert len(set(sequences)) == 5


def test_loss_zero_loses_nothing_and_loss_one_everything():
    assert None not in fates(Link(0, "a", "b", model(delay={"low": 0.002, "high": 0.05})))
    assert set(fates(Link(0, "a", "b", model(loss=1.0)))) == {None}


def test_a_constant_delay_is_that_delay():
    assert set(fates(Link(0, "a", "b", model(delay=0.01)))) == {0.01}
    delays = set(fates(Link(0, "a", "b", model(delay=0.01, loss=0.5))))
    assert delays == {None, 0.01}


def test_a_uniform_delay_fills_its_range_evenly_whatever_is_lost():
    delays = np.array([f for f in fates(Link(0, "a", "b", LOSSY)) if f is not None])
    assert delays.min() >= 0.002
    assert delays.max() <= 0.05
    assert kstest(delays, "uniform", args=(0.002, 0.048)).pvalue > 0.01


# The inbox. Broadcast k is sent at k/100 s.


def upto(*latest: int) -> dict[int, BroadcastRange]:
    """Return ranges of broadcasts of senders 0, 1, ... from 0 up to these; -1: none."""
    return {s: (0, k) for s, k in enumerate(latest) if k >= 0}


def newest(inbox: BroadcastInbox, sender: int = 0) -> int | None:
    received = inbox.received.get(sender)
    return None if received is None else int(received.u[0])


@pytest.mark.slow
@settings(max_examples=20)
@given(st.permutations(range(20)))
def test_what_was_received_does_not_depend_on_the_order_of_arrival(order):
    inbox = inbox_of(LOSSY)
    assert all(inbox.put(0, broadcast(k)) for k in order)
    for now in range(20):
        inbox.advance(upto(now), now / 100)
        arrived = [
            k
            for k in range(now + 1)
            if (delay := Link(0, "s0", "me", LOSSY).fate(k).delay) is not None
            and k / 100 + delay <= now / 100
        ]
        assert newest(inbox) == max(arrived, default=None)


def test_a_broadcast_is_missing_until_it_is_here_and_not_again_after_it_was_decided():
    inbox = inbox_of(model(), senders=2)
    assert not inbox.lacks(upto(-1, -1))
    assert inbox.lacks(upto(0, -1))
    inbox.put(0, broadcast(0))
    assert not inbox.lacks(upto(0, -1))
    assert inbox.lacks(upto(0, 0))
    assert inbox.lacks(upto(1, -1))
    inbox.put(0, broadcast(2))
    assert inbox.lacks(upto(2, -1))
    assert inbox.missing(upto(3, -1)) == {0: [1, 3]}
    inbox.put(0, broadcast(1))
    assert not inbox.lacks(upto(2, -1))
    inbox.advance(upto(2, -1), 1.0)
    assert not inbox.lacks(upto(2, -1))
    assert inbox.lacks(upto(3, -1))
    assert inbox.missing(upto(4, 0)) == {0: [3, 4], 1: [0]}


def test_of_a_sender_that_sends_at_every_third_sample_no_other_broadcast_is_missing():
    incoming = Incoming(every=3)
    assert incoming.missing(0, 7) == [0, 3, 6]
    assert incoming.missing(4, 9) == [6, 9]


def test_duplicates_and_replays_are_refused_and_change_nothing():
    inbox = inbox_of(model())
    assert inbox.put(0, broadcast(0))
    assert not inbox.put(0, broadcast(0))
    inbox.put(0, broadcast(1))
    inbox.advance(upto(1), 1.0)
    for old in (0, 1, -1):
        assert not inbox.put(0, broadcast(old))
    assert newest(inbox) == 1
    assert inbox.put(0, broadcast(2))


def test_the_first_of_two_claims_to_one_number_counts():
    inbox = inbox_of(model())
    inbox.put(0, broadcast(0))
    rival = Broadcast(k=0, t_apply=0.0, u=(99.0, 0.0))
    assert not inbox.put(0, rival)
    inbox.advance(upto(0), 1.0)
    assert inbox.received[0].u == (0.0, 0.0)


def test_a_broadcast_that_came_early_counts_only_once_the_sample_says_it_exists():
    inbox = inbox_of(model())
    for k in range(3):
        inbox.put(0, broadcast(k))
    inbox.advance(upto(0), 1.0)
    assert newest(inbox) == 0
    inbox.advance(upto(2), 1.0)
    assert newest(inbox) == 2


def test_a_delayed_broadcast_is_received_when_its_delay_is_over():
    inbox = inbox_of(model(delay=0.025))
    inbox.put(0, broadcast(1))
    inbox.put(0, broadcast(0))
    inbox.advance(upto(1), 0.02)
    assert newest(inbox) is None
    inbox.advance(upto(1), 0.025)
    assert newest(inbox) == 0
    inbox.advance(upto(1), 0.035)
    assert newest(inbox) == 1


def test_each_fate_is_reported_once_with_its_delay_and_a_negative_one_for_a_loss():
    inbox = inbox_of(LOSSY, senders=2)
    links = [Link(0, f"s{s}", "me", LOSSY) for s in (0, 1)]
    for s in (0, 1):
        for k in range(30):
            inbox.put(s, broadcast(k))
    fates = [
        *inbox.advance(upto(9, 4), 0.1),
        *inbox.advance(upto(9, 4), 0.2),
        *inbox.advance(upto(29, 4), 0.3),
    ]
    expected = []
    for s, count in ((0, 30), (1, 5)):
        for k in range(count):
            delivery = links[s].fate(k)
            lost = delivery.delay is None
            announced = None if lost else AnnouncedInput(broadcast(k).t_apply, broadcast(k).u)
            expected.append(
                DeliveryReport(s, k, -1.0 if lost else delivery.delay, delivery.faults, announced)
            )
    assert sorted(fates, key=lambda f: (f.sender, f.k)) == expected
    assert any(f.delay < 0 for f in fates)


def test_broadcasts_are_delivered_once_each_in_the_order_of_their_senders():
    inbox = inbox_of(model(delay=0.03), senders=3)
    inbox.put(2, broadcast(0))
    # What is counted at an earlier sample is in flight before the rest.
    inbox.advance({2: (0, 0)}, 0.01)
    for k, t in ((0, 0.03), (1, 0.05), (2, 0.06)):
        for sender in range(3):
            inbox.put(sender, broadcast(k))
        inbox.advance(upto(k, k, k), t)
        assert [(sender, each.k) for sender, each in inbox.delivered] == [(0, k), (1, k), (2, k)]


def test_who_goes_out_of_sight_is_forgotten_with_all_that_is_on_its_way():
    inbox = inbox_of(model(delay=0.03))
    for k in range(3):
        inbox.put(0, broadcast(k))
    inbox.advance({0: (0, 2)}, 0.035)
    assert newest(inbox) == 0
    inbox.advance({}, 0.04)
    assert newest(inbox) is None
    inbox.put(0, broadcast(3))
    inbox.advance({0: (3, 3)}, 0.055)
    assert newest(inbox) is None, "what was in flight arrives no more"
    inbox.advance({0: (3, 3)}, 0.06)
    assert newest(inbox) == 3


def test_who_comes_back_is_heard_again_from_its_first_broadcast_since():
    inbox = inbox_of(model())
    for k in (0, 1, 2, 4, 5, 6):
        inbox.put(0, broadcast(k))
    inbox.advance({0: (0, 1)}, 0.02)
    inbox.advance({}, 0.03)
    back = {0: (5, 6)}
    assert not inbox.lacks(back)
    fates = inbox.advance(back, 0.07)
    assert [fate.k for fate in fates] == [5, 6], "broadcasts 2 and 4 were of the contact before"
    assert newest(inbox) == 6
    assert not inbox.put(0, broadcast(2))


@pytest.mark.parametrize(("t", "received"), [(0.03, 0), (0.01, None)])
def test_a_new_contact_ends_the_old_one_with_what_came_and_what_is_on_its_way(t, received):
    inbox = inbox_of(model(delay=0.03))
    inbox.put(0, broadcast(0))
    inbox.advance({0: (0, 0)}, t)
    assert newest(inbox) == received
    inbox.put(0, broadcast(2))
    inbox.advance({0: (2, 2)}, 0.04)
    assert newest(inbox) is None, "broadcast 1 was not for this agent: 0 is in force no more"
    inbox.advance({0: (2, 2)}, 0.05)
    assert newest(inbox) == 2


def test_an_order_to_lose_all_counts_for_senders_of_whom_nothing_has_come_yet():
    inbox = inbox_of(model())
    inbox.override_links(loss=1.0, delay=None)
    for k, number in ((0, None), (1, 1)):
        inbox.put(0, broadcast(k))
        inbox.advance(upto(k), 1.0)
        assert newest(inbox) == number
        inbox.override_links(loss=None, delay=None)


def test_in_real_time_a_broadcast_counts_from_when_it_came_and_what_did_not_come_is_lost():
    inbox = BroadcastInbox([1], lambda _: Link(0, "b", "a", model(delay=0.01)))
    for k, at in ((0, 0.004), (2, 0.023)):
        assert inbox.put(1, Broadcast(k=k, t_apply=0.01 * k, u=(float(k),)), at)
    exist = {1: (0, 3)}
    arrived = inbox.up_to_newest(exist)
    assert arrived == {1: (0, 2)}
    assert inbox.lacks(exist)
    (first, second) = inbox.advance(arrived, 0.03)
    assert (first.k, first.delay) == (0, pytest.approx(0.014))
    assert (second.k, second.delay) == (2, pytest.approx(0.013))
    assert inbox.received[1].u == (0.0,), "the second is still on its way"
    assert not inbox.put(1, Broadcast(k=1, t_apply=0.01, u=(1.0,)), 0.031)
    inbox.advance(inbox.up_to_newest(exist), 0.033)
    assert inbox.received[1].u == (2.0,)


def test_in_real_time_no_broadcast_counts_before_its_input_takes_effect():
    inbox = BroadcastInbox([1], lambda _: Link(0, "b", "a", model()))
    inbox.put(1, Broadcast(k=0, t_apply=0.02, u=(1.0,)), 0.001)
    assert inbox.advance({1: (0, 0)}, 0.01)[0].delay == 0.0
    assert not inbox.received
    inbox.advance({1: (0, 0)}, 0.02)
    assert inbox.received


def test_in_real_time_what_comes_after_its_sample_and_before_the_step_is_there_at_once():
    inbox = inbox_of(model())
    inbox.put(0, broadcast(0), at=0.5)
    (fate,) = inbox.advance(upto(0), 0.25)
    assert newest(inbox) == 0
    assert fate.delay == 0.25
