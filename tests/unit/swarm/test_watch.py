"""Windows are checked only when every broadcast that covers them has come."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

import phalanx
from phalanx.network.inbox import Claim
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.swarm.watch import Watch, covering
from phalanx.wire.messages import Broadcast

SENT = {k: Claim(0.01 * k, (float(k),)) for k in range(10)}


def test_a_window_within_one_input_has_one_part():
    ((claim, seconds),) = covering(SENT, 0.031, 0.036) or []
    assert claim.u == (3.0,)
    assert seconds == pytest.approx(0.005)


def test_a_window_that_straddles_an_apply_time_is_split_there():
    parts = covering(SENT, 0.035, 0.052) or []
    assert [claim.u for claim, _ in parts] == [(3.0,), (4.0,), (5.0,)]
    assert [seconds for _, seconds in parts] == pytest.approx([0.005, 0.01, 0.002])


@pytest.mark.slow
@given(
    lost=st.sets(st.integers(0, 9)),
    begin=st.floats(0.0, 0.08),
    length=st.floats(1e-3, 0.05),
)
def test_a_lost_broadcast_leaves_its_windows_unchecked(lost, begin, length):
    arrived = {k: claim for k, claim in SENT.items() if k not in lost}
    parts, end = covering(arrived, begin, begin + length), begin + length
    in_force = {k for k in SENT if k in (max(j for j in SENT if SENT[j].t_apply <= begin),)}
    in_force |= {k for k in SENT if begin < SENT[k].t_apply < end}
    following = max(in_force) + 1
    if in_force & lost or following not in arrived:
        # An older one may look as if it were still in force, but then a number is missing.
        assert parts is None
    else:
        assert sum(seconds for _, seconds in parts or []) == pytest.approx(length)


def test_announcements_that_go_back_in_time_are_not_checked():
    back = {0: Claim(0.0, (0.0,)), 1: Claim(0.02, (0.0,)), 2: Claim(0.01, (0.0,))}
    assert covering({**back, 3: Claim(0.05, (0.0,))}, 0.0, 0.04) is None


def watching(**changes: object) -> tuple[Swarm, Watch]:
    """Agent 1's watch, when agent 2 has stood still for three periods, as it announced."""
    scenario = phalanx.load("guaranteed", {"safety.information": "earned", **changes})
    swarm = build_swarm(scenario)
    watch, tau = Watch(swarm, 0), swarm.horizon(0)
    for k in range(4):
        sent = Broadcast(k=k, t_apply=tau * k, u=(0.0, 0.0))
        assert watch(tau * k, swarm.start(), (0, 1), [(1, sent)]) == []
    return swarm, watch


def test_trust_ends_within_the_time_that_a_conviction_takes():
    """A window of which the last instant was honest passed, and no broadcast has come since."""
    swarm, watch = watching()
    own, other = swarm.horizon(0), swarm.horizon(1)
    begun, checked = 2.0 * own, 3.0 * own
    ends = checked + 3.0 * own + other
    assert watch.trusted(ends - 1e-9) == {1}
    assert watch.trusted(ends + 1e-9) == frozenset()
    # The last input that rests on trust is held for one more period.
    assert watch.conviction_takes[1] == pytest.approx(ends + own - begun)


def test_a_state_of_its_own_that_an_agent_made_up_convicts_it():
    audit = {"safety.evidence": True, "safety.audit": True}
    swarm, watch = watching(**audit)
    at, true = 3.5 * swarm.horizon(0), swarm.start()[swarm.safe_set.parts[1]]
    watch._claims[1][4] = Claim(4.0 * swarm.horizon(0), (0.0, 0.0))
    assert watch.contradicts(1, at, true) is None
    found = watch.contradicts(1, at, true + 0.1)
    assert found is not None
    assert found.of == 1
    assert watch.convicted == {1}


def test_a_window_that_no_box_covers_earns_no_trust():
    """Drag slows agent 2 within milliseconds: no box is proven for a window of 50 ms."""
    group = {
        "role": "normal", "names": ["1", "2"], "start": [[0.0] * 4, [6.0, 0.0, 0.0, 0.0]],
        "dynamics": {"type": "double-integrator", "acceleration": 40.0, "drag": 20.0,
                     "dimension": 2},
        "law": {"type": "track", "gains": [1.0, 2.0]}, "clock": {"period": 0.05},
        "disturbance": {"bound": 0.05},
    }  # fmt: skip
    safety = {
        "function": {"type": "separation", "radius": 1.0}, "rho": 10.0, "alpha": [1.0, 5.0],
        "information": "earned", "composition": "pairs", "margin": "local",
    }  # fmt: skip
    scenario = {"name": "drag", "duration": 1.0, "safety": safety, "agents": [group]}
    swarm = build_swarm(phalanx.load(scenario))
    watch, x = Watch(swarm, 0), swarm.start()
    for k in range(6):
        # It jumps half a metre at a time, and announces rest.
        x[swarm.safe_set.parts[1].start] = 6.0 - 0.5 * (k % 2)
        sent = Broadcast(k=k, t_apply=0.05 * k, u=(0.0, 0.0))
        assert watch(0.05 * k, x, (0, 1), [(1, sent)]) == []
        assert watch.trusted(0.05 * k) == set()
