"""Duplicates, damage, queues, slots, faults of a time, and rules of one's own."""

import itertools
from dataclasses import dataclass
from typing import get_args

import numpy as np
import pytest

from phalanx.faults.links import Hold
from phalanx.messages.keys import Keys
from phalanx.messages.seal import Malformed, Sealer
from phalanx.network.draws import Draws
from phalanx.network.link import Kind, Link, LinkModel, RuleError, Stage
from phalanx.network.rule import CORRUPT, DELIVER, DROP, DUPLICATE, Cut, During, Message, delay
from tests.unit.network.models import broadcast, inbox_of, model

MANY = 20_000


@pytest.mark.slow
def test_a_duplicate_goes_its_own_way_and_the_first_to_arrive_counts():
    uniform = {"low": 0.0, "high": 0.1}
    link = Link(0, "a", "b", model(duplicate=0.25, delay=uniform))
    deliveries = [link.fate(k) for k in range(MANY)]
    twice = [p for p in deliveries if len(p.copies) == 2]
    assert len(twice) / MANY == pytest.approx(0.25, abs=4.0 * np.sqrt(0.25 * 0.75 / MANY))
    assert np.mean([p.delay for p in twice]) == pytest.approx(0.1 / 3.0, rel=0.05)
    one, two = np.array([[copy.after for copy in p.copies] for p in twice]).T
    assert abs(np.corrcoef(one, two)[0, 1]) < 0.06
    single = Link(0, "a", "b", model(delay=uniform))
    assert all(p.copies[0] == single.fate(k).copies[0] for k, p in enumerate(deliveries[:1000]))


def test_an_inbox_takes_a_duplicate_once():
    inbox = inbox_of(LinkModel((Stage("duplicate", Always(DUPLICATE)),)), count=3)
    fates = inbox.advance({0: (0, 2)}, 1.0)
    assert [fate.delay for fate in fates] == [0.0, 0.0, 0.0]
    assert inbox.received[0].u == (2.0, 0.0)
    assert not inbox.put(0, broadcast(2))
    twice = model(duplicate=1.0, delay={"low": 0.0, "high": 0.1})
    link, fates = Link(0, "s0", "me", twice), inbox_of(twice, count=20).advance({0: (0, 19)}, 1.0)
    assert [fate.delay for fate in fates] == [link.fate(k).delay for k in range(20)], "the earlier"


def test_a_damaged_broadcast_is_lost_and_refused_by_the_seal():
    link = Link(0, "s0", "me", model(corrupt=0.2))
    damaged = [k for k in range(MANY) if link.fate(k).delay is None]
    assert len(damaged) / MANY == pytest.approx(0.2, abs=4.0 * np.sqrt(0.16 / MANY))
    inbox = inbox_of(model(corrupt=0.2), count=200)
    fates = inbox.advance({0: (0, 199)}, 9.0)
    corrupt = inbox.corrupt
    assert (
        [m.k for _, m in corrupt]
        == [f.k for f in fates if f.delay < 0.0]
        == damaged[: len(corrupt)]
    )
    inbox.advance({0: (0, 199)}, 9.0)
    assert inbox.corrupt == []
    key, sealer = Keys("run").broadcast("a", "b"), Sealer(b"secret")
    for k in range(256):
        with pytest.raises(Malformed, match="bad seal"):
            sealer.open_damaged(key, broadcast(k), k)


def test_a_narrow_link_carries_one_message_after_the_other():
    # 128 bytes at 51.2 kbit/s take 20 ms; one is sent every 10 ms: each waits 10 ms more.
    link = Link(0, "a", "b", model(rate={"bits_per_second": 51_200.0}))
    delays = [link.fate(k, sent=0.01 * k).delay for k in range(50)]
    assert delays == pytest.approx([0.02 + 0.01 * k for k in range(50)])
    # After a pause nothing waits any more.
    assert link.fate(50, sent=10.0).delay == pytest.approx(0.02)


@pytest.mark.parametrize("limit", [1, 2, 3, 8])
def test_a_queue_takes_what_comes_exactly_while_it_holds_less_than_its_limit(limit: int):
    link = Link(0, "a", "b", model(rate={"bits_per_second": 51_200.0, "limit": limit}))
    through, t_sent = list[float](), 0.0
    for k, pause in enumerate(np.random.default_rng(1).uniform(0.0, 0.03, 500)):
        t_sent += pause
        count = sum(t > t_sent for t in through)
        delay = link.fate(k, sent=t_sent).delay
        assert (delay is not None) == (count < limit)
        if delay is not None:
            through.append(t_sent + delay)


def test_what_comes_in_a_slot_is_delivered_at_its_end():
    link = Link(0, "a", "b", model(slot=0.1, delay=0.03))
    arrivals = [0.01 * k + link.fate(k, sent=0.01 * k).delay for k in range(25)]
    assert sorted(set(np.round(arrivals, 12))) == [0.1, 0.2, 0.3]
    assert arrivals[:8] == pytest.approx([0.1] * 8)


@pytest.mark.parametrize("sent", [-1.7e308, -1e17, 1e17, 1.7e308])
def test_a_time_of_sending_that_is_a_lie_fails_no_rule(sent: float):
    table = {"delay": 0.03, "slot": 0.1, "rate": {"bits_per_second": 5e4, "limit": 3}}
    for earlier in (-sent, 0.0, sent):
        link = Link(0, "a", "b", model(**table))
        for k, t in enumerate((earlier, sent, earlier)):
            assert all(0.0 <= copy.after < np.inf for copy in link.fate(k, sent=t).copies)


def test_a_partition_loses_what_is_sent_in_its_time():
    link = Link(0, "a", "b", LinkModel((Stage("faults.0", During(0.2, 0.5, Cut()), 0),)))
    gone = [k for k in range(100) if link.fate(k, sent=k / 100).delay is None]
    assert gone == list(range(20, 50))
    assert link.fate(20, sent=0.2).faults == (0,)
    assert link.fate(19, sent=0.19).faults == ()


def test_a_hold_releases_all_that_would_have_arrived_meanwhile_at_once():
    rule = LinkModel((*model(delay=0.05).stages, Stage("faults.0", Hold(0.2, 0.5), 0)))
    link = Link(0, "a", "b", rule)
    arrivals = [k / 100 + link.fate(k, sent=k / 100).delay for k in range(100)]
    expected = [t + 0.05 for t in np.arange(100) / 100]
    assert arrivals == pytest.approx([0.5 if 0.2 <= t < 0.5 else t for t in expected])
    inbox = inbox_of(rule, count=60)
    inbox.advance({0: (0, 48)}, 0.499)
    assert inbox.received[0].u[0] == 14
    inbox.advance({0: (0, 49)}, 0.5)
    assert inbox.received[0].u[0] == 45


@dataclass(frozen=True)
class Always:
    """The same treatment for every message."""

    treatment: tuple

    def treat(self, message):
        return self.treatment


@dataclass(frozen=True)
class Rain:
    """The farther apart, the more is lost; what is left is late at times."""

    per_metre: float

    def treat(self, message):
        if message.draw("rain") < self.per_metre * message.distance:
            return DROP
        return delay(0.01) if message.draw("late") < 0.5 else DELIVER


RAIN = {"type": f"{__name__}:Rain", "per_metre": 0.01}


@pytest.mark.slow
def test_a_rule_of_ones_own_takes_a_dozen_lines():
    link = Link(0, "a", "b", model(rules=[RAIN]))
    assert link.asks_distance
    deliveries = [link.fate(k, distance=30.0) for k in range(20_000)]
    assert np.mean([f.delay is None for f in deliveries]) == pytest.approx(0.3, abs=0.015)
    delays = [f.delay for f in deliveries if f.delay is not None]
    assert np.mean(np.array(delays) == 0.01) == pytest.approx(0.5, abs=0.02)


def test_an_inbox_tells_a_rule_how_far_away_the_sender_is():
    inbox = inbox_of(model(rules=[RAIN]), count=40)
    far = inbox.advance({0: (0, 19)}, 1.0, lambda _: 100.0)
    near = inbox.advance({0: (0, 39)}, 1.0, lambda _: 0.0)
    assert [fate.delay < 0.0 for fate in (*far, *near)] == [True] * 20 + [False] * 20


@pytest.mark.slow
def test_two_rules_of_one_class_draw_each_for_itself():
    link = Link(0, "a", "b", model(rules=[RAIN, RAIN]))
    found = [link.fate(k, distance=50.0).delay is None for k in range(20_000)]
    assert np.mean(found) == pytest.approx(0.75, abs=0.015)


@pytest.mark.slow
@pytest.mark.parametrize("column", [0, 1])
def test_each_of_a_messages_draws_is_kept_by_chance_of_its_own(column):
    """Loss and delay of a message may be drawn side by side: neither has a part in the other."""

    tables = {purpose: Draws(0, purpose, width=2) for purpose in ("wind", "wind kept")}
    before = tables["wind"].value(0, column)
    for k in range(600):
        message = Message("a", "b", k, 0.0, 0.0, 1.0, 0, 0.0, tables)
        if tables["wind kept"].value(k, column) >= 0.7:
            before = tables["wind"].value(k, column)
        assert message.draw("wind", column, correlation=0.7) == before


@pytest.mark.slow
def test_what_changes_on_one_link_changes_nothing_on_another():
    calm = {"loss": 0.2, "delay": {"low": 0.0, "high": 0.1}}
    wild = {**calm, "loss": {"mean": 0.5, "burst": 3.0}, "duplicate": 0.3, "corrupt": 0.1}
    ends = list(itertools.permutations("abc", 2))

    def fates(models):
        return {
            e: [Link(1, *e, model(**models.get(e, calm))).fate(k).copies for k in range(200)]
            for e in ends
        }

    before, after = fates({}), fates({("a", "b"): wild})
    assert {e for e in ends if before[e] != after[e]} == {("a", "b")}


def test_effects_are_counted_by_the_number_of_the_rule():
    link = Link(0, "a", "b", model(loss=0.5, duplicate=0.5, delay=0.01))
    for k in range(500):
        delivery = link.fate(k)
        expected = (0,) if delivery.delay is None else (1, 2) if len(delivery.copies) == 2 else (2,)
        assert delivery.faults == expected


@dataclass(frozen=True)
class Recorded:
    """Keeps when the message before each left it."""

    previous: list[float]

    def treat(self, message):
        self.previous.append(message.previous)
        return DELIVER


def test_a_rule_after_a_delay_sees_when_the_message_before_left_it():
    rule = Recorded([])
    link = Link(0, "a", "b", LinkModel((Stage("a", Always(delay(0.5))), Stage("b", rule))))
    for k, sent in enumerate((1.0, 2.5, 4.0)):
        link.fate(k, sent)
    assert rule.previous == [-np.inf, 1.5, 3.0]


def test_each_kind_of_message_and_each_link_has_draws_of_its_own():
    kinds = [(*ends, kind) for ends in ("ab", "ba", "aa") for kind in get_args(Kind)]
    lost = {}
    for a, b, kind in kinds:
        link = Link(7, a, b, model(loss=0.5), kind)
        lost[a, b, kind] = tuple(link.fate(k).delay is None for k in range(64))
    assert len({*lost.values()}) == len(kinds)
    draws = Draws(7, "link", "a", "b", width=2)
    assert lost["a", "b", "broadcast"] == tuple(draws.value(k) < 0.5 for k in range(64))


def test_damage_to_one_copy_leaves_the_other():
    stages = (
        Stage("a", Always(DUPLICATE)),
        Stage("b", OnlyFirst()),
        Stage("c", Always(delay(0.5))),
    )
    delivery = Link(0, "a", "b", LinkModel(stages)).fate(0)
    assert [copy.corrupt for copy in delivery.copies] == [True, False]
    assert delivery.delay == 0.5


@dataclass(frozen=True)
class OnlyFirst:
    """Damages the original alone."""

    def treat(self, message):
        return DELIVER if message.copy else CORRUPT


@dataclass(frozen=True)
class Wrong:
    """Says what cannot be."""

    says: str

    def treat(self, message):
        return {"nothing": None, "early": delay(-0.1), "never": delay(float("inf"))}[self.says]


@pytest.mark.parametrize("says", ["nothing", "early", "never", "a secret"])
def test_a_rule_that_says_what_cannot_be_is_named(says):
    link = Link(0, "a", "b", model(rules=[{"type": f"{__name__}:Wrong", "says": says}]))
    why = (
        ".*KeyError" if says == "a secret" else r"Wrong\.treat: expected DELIVER, DROP, or a tuple"
    )
    with pytest.raises(RuleError, match=rf"rule rules\.0 failed at message 7 from a to b: {why}"):
        link.fate(7)


def test_a_rule_of_ones_own_asks_for_distances_for_a_time_too():
    rain = Stage("faults.0", During(0.0, 1.0, Rain(0.1)))
    assert Link(0, "a", "b", LinkModel((rain,))).asks_distance
    assert not Link(0, "a", "b", model(loss=0.1, delay=0.1, slot=0.1)).asks_distance
