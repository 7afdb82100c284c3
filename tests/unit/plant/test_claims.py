"""Claims that agents broadcast, compared with their actuators' inputs."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from phalanx_plant.judge.claims import TRUE, Claims, FalseClaims, Finding
from phalanx_plant.judge.event_columns import EventColumns
from phalanx_plant.world.events import InputApplied, InputLost

from phalanx.network.inbox import AnnouncedInput, DeliveryReport
from phalanx.recording.columns import TrueStates
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm
from tests.unit.plant.runs import report

TRUTH, LIE = AnnouncedInput(0.03, (1.0, 0.5)), AnnouncedInput(0.03, (-1.0, -0.5))


class Told(Claims):
    """The claims of Simulation 1, where agent 2 lies."""

    def __init__(self, **lie: object) -> None:
        faults = [{"kind": "lie", "agent": "2", "for": 9.0, **lie}] if lie else []
        swarm = build_swarm(load("unicycles", {"faults": faults}))
        super().__init__(swarm)
        self._columns, self._x = EventColumns(swarm, self), swarm.start()
        self._ks = dict.fromkeys(range(5), 100)

    def add_truth(self, i: int, k: int, planned: AnnouncedInput, held_from: float) -> None:
        """Let agent i's input k take effect."""
        self._happen(i, k, planned.t_apply, held_from, planned.u)

    def check(self, receiver: int, fate: DeliveryReport, t: float) -> Finding:
        """Return what is found of a broadcast that an agent reports with its next input."""
        self._ks[receiver] += 1
        truths = self._happen(receiver, self._ks[receiver], t, t, (0.0, 0.0), fate)
        return truths.get(0, {}).get(0, TRUE)

    def _happen(
        self, i: int, k: int, t: float, held_from: float, u: tuple[float, ...],
        *fates: DeliveryReport,
    ) -> FalseClaims:  # fmt: skip
        kind = InputLost if held_from == math.inf else InputApplied
        event = kind(i, k, t, t if kind is InputLost else held_from, np.array(u))
        columns = self._columns.of([replace(event, telemetry=report(k, fates=fates))])
        nowhere = np.zeros(1, dtype=np.intp)
        x = TrueStates(self._x[None], nowhere, nowhere)
        return self.add(columns.inputs, x, columns.stated)

    def heard_false(self, receiver: int, t_apply: float, by: int = 1000) -> bool:
        """Return whether an agent was misled by agent 2, as known by an event's number."""
        columns = np.array([receiver]), np.array([1]), np.array([t_apply]), np.array([by])
        return bool(self.misled(*columns)[0])


def claims(**lie: object) -> Told:
    return Told(**lie)


def counted(checked: Claims) -> tuple[int, int, float | None]:
    return checked.truthful.failed, checked.truthful.checked, checked.truthful.first


def test_a_claim_is_true_if_it_is_the_actuators_input_and_its_time():
    checked = claims()
    checked.add_truth(1, 3, TRUTH, TRUTH.t_apply)
    assert checked.check(0, DeliveryReport(1, 3, 0.0, (), TRUTH), 0.04) == Finding()
    for t, false in ((0.05, LIE), (0.06, AnnouncedInput(0.031, TRUTH.u))):
        assert checked.check(0, DeliveryReport(1, 3, 0.0, (), false), t) == Finding(false=True)
    assert counted(checked) == (2, 3, 0.05)
    assert checked.truthful.note.endswith("false were 2 by 2")


def test_a_lost_broadcast_claims_nothing():
    checked = claims()
    checked.add_truth(1, 3, TRUTH, TRUTH.t_apply)
    checked.check(0, DeliveryReport(1, 3, -1.0), 0.04)
    assert counted(checked) == (0, 0, None)


def test_a_claim_received_before_its_input_reached_the_actuator_is_checked_after():
    checked = claims(says="opposite")
    checked.add_truth(1, 2, TRUTH, TRUTH.t_apply)
    assert checked.check(0, DeliveryReport(1, 3, 0.0, (), LIE), 0.04) == Finding()
    assert counted(checked) == (0, 0, None)
    checked.add_truth(1, 3, TRUTH, TRUTH.t_apply)
    assert counted(checked) == (1, 1, 0.04)
    assert checked.faults == {0: 1}


def test_a_declared_lie_is_counted_for_each_peer_that_heard_it():
    checked = claims(says="opposite", to=["1"])
    checked.add_truth(1, 3, TRUTH, TRUTH.t_apply)
    assert checked.check(0, DeliveryReport(1, 3, 0.0, (), LIE), 0.04) == Finding(True, (0,))
    assert checked.check(2, DeliveryReport(1, 3, 0.0, (), TRUTH), 0.04) == Finding()
    # No fault declares that agent 3 is lied to as well: a lie of the agent's own, or agent 3's.
    assert checked.check(2, DeliveryReport(1, 3, 0.0, (), LIE), 0.05) == Finding(True)
    assert checked.faults == {0: 1}
    assert counted(checked) == (2, 3, 0.04)


def test_a_replayed_input_is_recognised_from_earlier_ones():
    checked = claims(replay=2)
    old = AnnouncedInput(0.01, (4.0, 0.0))
    for k, claim in ((1, old), (3, TRUTH)):
        checked.add_truth(1, k, claim, claim.t_apply)
    replayed = AnnouncedInput(TRUTH.t_apply, old.u)
    assert checked.check(0, DeliveryReport(1, 3, 0.0, (), replayed), 0.04).lies == (0,)


@pytest.mark.parametrize("held_from", [0.0345, math.inf])
def test_an_input_that_was_held_late_or_never_makes_its_broadcast_false(held_from):
    checked = claims()
    checked.add_truth(1, 3, TRUTH, held_from)
    assert checked.check(0, DeliveryReport(1, 3, 0.0, (), TRUTH), 0.04) == Finding(false=True)
    assert checked.betrayals == {"2": TRUTH.t_apply}
    assert not checked.faults


def test_an_adversary_accuses_no_one():
    checked = claims()
    checked.add_truth(1, 3, TRUTH, TRUTH.t_apply)
    assert checked.check(4, DeliveryReport(1, 3, 0.0, (), LIE), 0.04) == Finding()
    assert counted(checked) == (0, 0, None)
    assert not checked.betrayals


def test_who_heard_a_false_claim_was_misled_from_the_time_that_it_names():
    checked = claims(says="opposite", to=["1"])
    checked.add_truth(1, 3, TRUTH, TRUTH.t_apply)
    for receiver, claim in ((0, LIE), (2, TRUTH)):
        checked.check(receiver, DeliveryReport(1, 3, 0.0, (), claim), 0.04)
    # As ages are reported, and times are sums of periods.
    assert [checked.heard_false(i, 0.04 - (0.04 - LIE.t_apply)) for i in (0, 2)] == [True, False]
    assert all(checked.heard_false(0, LIE.t_apply + off) for off in (-1e-9, 1e-9))
    assert not checked.heard_false(0, LIE.t_apply - 0.01)
    assert [checked.heard_false(0, LIE.t_apply, by) for by in (0, 1)] == [False, True]
