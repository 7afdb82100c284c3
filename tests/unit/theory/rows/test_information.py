"""Information models: received inputs count only while they are in force."""

import pytest

from phalanx.network.inbox import Claim
from phalanx.theory.rows.information import Information, InformationModel

PLENTY = InformationModel(Information.IN_FLIGHT, {0: 0.008, 1: 0.008}, 1.0)


def test_in_flight_trusts_an_input_only_while_no_newer_one_can_be_in_force():
    heard = {1: Claim(0.5, (1.0, 1.0))}
    assert list(PLENTY.usable(heard, 0.5079)) == [1]
    assert list(PLENTY.usable(heard, 0.5081)) == []


def test_in_flight_does_not_trust_the_input_of_an_agent_that_may_sample_at_this_very_instant():
    assert PLENTY.usable({1: Claim(0.1, (1.0, 1.0))}, 0.1 + 0.008) == {}


@pytest.mark.parametrize("information", [Information.SPLIT, Information.WORST_CASE])
def test_split_and_worst_case_count_on_no_received_input(information):
    trust = InformationModel(information, {0: 0.008, 1: 0.008}, 1.0)
    assert trust.usable({1: Claim(0.0, (1.0, 1.0))}, 0.0) == {}


def test_a_silent_neighbour_is_counted_on_no_more():
    heard = {1: Claim(0.5, (1.0, 1.0))}
    paper = InformationModel(Information.PAPER, {0: 0.008, 1: 0.008}, 1.0)
    assert list(paper.usable(heard, 1.4)) == [1]
    assert list(paper.usable(heard, 1.6)) == []
    split = InformationModel(Information.SPLIT, {0: 0.008, 1: 0.008}, 1.0)
    assert split.sharing(0, {}, 0.9) == [0, 1]
    assert split.sharing(0, {}, 1.1) == [0]
    assert split.sharing(0, heard, 1.4) == [0, 1]
    assert split.sharing(0, heard, 1.6) == [0]
