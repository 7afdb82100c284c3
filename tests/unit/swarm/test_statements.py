"""Statements by radio: what a broadcast repeats of others."""

from phalanx.network.inbox import AnnouncedInput, DeliveryReport
from phalanx.swarm.statements import OwnStatement, StatementLedger
from tests.unit.swarms import swarm_of_scenario

ZERO, REST = (0.0, 0.0), (0.0, 0.0, 0.0, 0.0)


def test_of_what_an_agent_has_heard_it_repeats_the_newest_and_no_more_than_it_may():
    """Agent 1 had older news of agent 2 than of agent 3, and repeats one of them to agent 4."""
    ledger = StatementLedger(swarm_of_scenario("radio", "agents.0.radio.relays=1"))
    for l, k in ((1, 5), (2, 7)):
        ledger.known[0][l] = OwnStatement(k, 0.1 * k, REST, 0.1 * k, ZERO)
    ledger.sampled(0, 1.0, 0, REST, [], [])
    fate = DeliveryReport(0, 0, 0.0, (), AnnouncedInput(1.0, ZERO, REST))
    ledger.sampled(3, 1.1, 1, REST, [fate], [])
    assert {l: ledger.known[3][l].k for l in (0, 1, 2)} == {0: 0, 1: -1, 2: 7}
