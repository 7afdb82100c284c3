"""Compiled functions that serve the next run of a process, if all that they depend on is equal."""

import threading

import pytest

import phalanx
from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.native.library import missing
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.cache import FunctionCache, cached


def test_an_equal_key_has_the_same_result_and_another_its_own():
    first = cached(("a", 1), object)
    assert cached(("a", 1), object) is first
    assert cached(("a", 2), object) is not first


def test_the_oldest_goes_first():
    functions = FunctionCache(2)
    first, second = functions.get("first", object), functions.get("second", object)
    assert functions.get("first", object) is first
    functions.get("third", object)
    assert functions.get("first", object) is first
    assert functions.get("second", object) is not second


def test_each_thread_has_its_own():
    others = []
    other = threading.Thread(target=lambda: others.append(cached("shared", object)))
    first = cached("shared", object)
    other.start()
    other.join()
    assert others[0] is not first


def test_to_collect_what_is_not_machine_code_yet_all_is_made_again():
    first = cached("collected", object)
    with missing():
        inside = cached("collected", object)
    with missing():
        assert cached("collected", object) is not inside
    assert inside is not first


def certificate(name, **overrides):
    """The compiled certificate of the first pair of agent 1."""
    certificates = SwarmCertificates(build_swarm(phalanx.load(name, overrides)))
    return certificates.kinds[certificates.of(0).kinds[0]].certificate


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "field", "value"),
    [
        ("unicycles", "agents.0.disturbance.bound", 0.1),
        ("unicycles", "agents.0.clock.period", 0.02),
        ("unicycles", "agents.0.dynamics.speed", 0.7),
        ("unicycles", "agents.0.dynamics.offset", 0.3),
        ("unicycles", "safety.function.radius", 1.5),
        ("unicycles", "time.latency", 0.001),
        ("formation3d", "safety.alpha.0", 0.6),
    ],
)
def test_a_certificate_is_that_of_another_run_only_where_nothing_in_it_differs(name, field, value):
    first = certificate(name, seed=1)
    assert certificate(name, seed=2, **{"network.loss": 0.5}) is first
    assert certificate(name, **{field: value}) is not first
