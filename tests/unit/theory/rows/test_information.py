"""Information models: received inputs count only while they are in force."""

import numpy as np
import pytest

from phalanx.network.inbox import AnnouncedInput
from phalanx.schema.built_in import BUILT_IN
from phalanx.theory.rows.information import (
    InFlight,
    Information,
    Paper,
    Split,
    Together,
    Unknown,
    WorstCase,
)
from phalanx.theory.rows.safety_filter import FilterInput
from tests.unit.swarms import rows_of_scenario

PLENTY = InFlight({0: 0.02, 1: 0.008, 2: 0.004}, 1.0)


def test_in_flight_trusts_an_input_only_while_no_newer_one_can_be_in_force():
    heard = {1: AnnouncedInput(0.5, (1.0, 1.0))}
    assert list(PLENTY.usable(heard, 0.5079)) == [1]
    assert list(PLENTY.usable(heard, 0.5081)) == []
    # Nor at the very instant at which it may sample.
    assert PLENTY.usable({1: AnnouncedInput(0.1, (1.0, 1.0))}, 0.1 + 0.008) == {}


@pytest.mark.parametrize("information", [Split, WorstCase])
def test_split_and_worst_case_count_on_no_received_input(information):
    trust = information({0: 0.008, 1: 0.008}, 1.0)
    assert trust.usable({1: AnnouncedInput(0.0, (1.0, 1.0))}, 0.0) == {}


def test_a_silent_neighbour_is_counted_on_no_more():
    heard = {1: AnnouncedInput(0.5, (1.0, 1.0))}
    paper = Paper({0: 0.008, 1: 0.008}, 1.0)
    assert list(paper.usable(heard, 1.4)) == [1]
    assert list(paper.usable(heard, 1.6)) == []
    split = Split({0: 0.008, 1: 0.008}, 1.0)
    assert split.sharing(0, {}, 0.9, (0, 1, 2)) == [0, 1], "agent 2 is an adversary"
    assert split.sharing(0, {}, 1.1, (0, 1)) == [0]
    assert split.sharing(0, heard, 1.4, (0, 1)) == [0, 1]
    assert split.sharing(0, heard, 1.6, (0, 1)) == [0]


@pytest.mark.parametrize("composition", ["lse", "pairs"])
def test_an_input_that_its_sender_cannot_apply_is_not_believed(composition):
    """Agent 2, 1.5 m away, says that it leaves at its 4 m/s, or at 4.1 m/s."""
    rows = rows_of_scenario("faults/hijack", f"safety.composition={composition}")
    x, agents = np.array([0.0, 0.0, 1.5, 0.0, *[np.nan] * 4]), (0, 1)
    bounds = []
    for speed, senders in ((4.0, [1]), (4.1, []), (None, [])):
        received = {} if speed is None else {1: AnnouncedInput(0.0, (speed, 0.0))}
        terms = rows.terms(0)(x, agents)
        filtered = rows.filter(0)(FilterInput(0.0, x, agents, terms, np.zeros(2), received))
        assert filtered.used == senders
        bounds.append(np.ravel(filtered.rows.bound).tolist())
    assert bounds[0] > bounds[1] == bounds[2]


@pytest.mark.parametrize("model", [InFlight, Paper, Split, WorstCase, Unknown, Together])
def test_a_model_says_whether_received_inputs_count(model):
    """Only then the verdict checks whether they were in force, and broadcasts true."""
    fresh = model({1: 1.0}, 1.0).usable({1: AnnouncedInput(0.0, (1.0,))}, 0.5)
    assert model.counts_on_received == bool(fresh)


class Newest(Information):
    """Believes the newest input for ever."""

    label = "information is newest"
    counts_on_received = True

    def counts(self, l, received, t):
        return True


def test_a_new_model_is_a_class_and_its_name(monkeypatch):
    monkeypatch.setitem(BUILT_IN[Information], "newest", f"{__name__}:Newest")
    rows = rows_of_scenario("unicycles", "safety.information=newest")
    assert list(rows.swarm.information().usable({1: AnnouncedInput(0.0, (1.0, 1.0))}, 99.0)) == [1]
    assert rows.swarm.safety.information_model.reads_roles
