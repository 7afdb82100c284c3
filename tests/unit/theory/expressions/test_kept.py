"""Compiled functions that serve the next run of a process, if all that they depend on is equal."""

import threading

import pytest

import phalanx
from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.kept import _MOST, kept
from phalanx.theory.expressions.native import missing


def test_an_equal_key_has_the_same_result_and_another_its_own():
    first = kept(("a", 1), object)
    assert kept(("a", 1), object) is first
    assert kept(("a", 2), object) is not first


def test_the_oldest_goes_first():
    first, second = kept(("old", 1), object), kept(("old", 2), object)
    for number in range(_MOST - 1):
        kept(("new", number), object)
    assert kept(("old", 2), object) is second
    assert kept(("old", 1), object) is not first


def test_each_thread_has_its_own():
    others = []
    other = threading.Thread(target=lambda: others.append(kept("shared", object)))
    first = kept("shared", object)
    other.start()
    other.join()
    assert others[0] is not first


def test_to_collect_what_is_not_machine_code_yet_all_is_made_again():
    first = kept("collected", object)
    with missing():
        inside = kept("collected", object)
    with missing():
        assert kept("collected", object) is not inside
    assert inside is not first


def certificate(**overrides):
    """The compiled certificate of the first pair of agent 1."""
    swarm = build_swarm(phalanx.load("unicycles", overrides))
    certificates = SwarmCertificates(swarm)
    return certificates.kinds[certificates.of(0).kinds[0]].certificate


@pytest.mark.slow
@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("agents.0.disturbance.bound", 0.1),
        ("agents.0.clock.period", 0.02),
        ("agents.0.dynamics.speed", 0.7),
        ("agents.0.dynamics.offset", 0.3),
        ("safety.function.radius", 1.5),
        ("time.latency", 0.001),
    ],
)
def test_a_certificate_is_that_of_another_run_only_where_nothing_in_it_differs(field, value):
    first = certificate(seed=1)
    assert certificate(seed=2, **{"network.loss": 0.5}) is first
    assert certificate(**{field: value}) is not first


@pytest.mark.slow
def test_the_gains_of_the_chain_are_a_part_of_it():
    def of(gain):
        swarm = build_swarm(phalanx.load("formation3d", {"safety.alpha.0": gain}))
        certificates = SwarmCertificates(swarm)
        return certificates.kinds[certificates.of(0).kinds[0]].certificate

    assert of(0.5) is of(0.5)
    assert of(0.5) is not of(0.6)
