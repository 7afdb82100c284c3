"""An agent leaves with the plant, and not with a router that comes back."""

import threading

import pytest

from phalanx.wire.liveliness import PlantPresence

PATIENCE = 0.05


@pytest.fixture
def presence():
    reasons, departure = [], threading.Event()

    def leave(why: str) -> None:
        reasons.append(why)
        departure.set()

    presence = PlantPresence(PATIENCE, leave)
    presence.reasons, presence.departure = reasons, departure
    presence.on_plant("", True)
    return presence


def test_without_a_router_the_hub_is_the_plant(presence) -> None:
    presence.on_disconnect()
    assert presence.reasons == ["the connection to the hub was lost"]


def test_before_the_first_sample_a_hub_that_comes_back_was_not_lost() -> None:
    departure = threading.Event()
    presence = PlantPresence(PATIENCE, lambda _: departure.set(), begun=lambda: False)
    presence.on_plant("", False)
    presence.on_disconnect()
    assert not departure.is_set()
    presence.on_plant("", True)
    assert not departure.wait(2.0 * PATIENCE)


@pytest.mark.parametrize("tokens_first", [True, False])
def test_a_program_that_loses_the_router_waits_for_the_plant(presence, tokens_first: bool) -> None:
    presence.on_router("", True)
    if tokens_first:
        presence.on_plant("", False)
    presence.on_disconnect()
    if not tokens_first:
        presence.on_plant("", False)
    presence.on_plant("", True)
    assert not presence.departure.wait(2.0 * PATIENCE)


@pytest.mark.parametrize("tokens_first", [True, False])
def test_but_not_for_ever(presence, tokens_first: bool) -> None:
    presence.on_router("", True)
    if tokens_first:
        presence.on_plant("", False)
    presence.on_disconnect()
    assert presence.departure.wait(30.0)
    assert presence.reasons == ["the plant is not back at its router"]


@pytest.mark.parametrize("router_first", [True, False])
def test_a_plant_that_went_with_a_distant_router_may_come_back(
    presence, router_first: bool
) -> None:
    presence.on_router("near", True)
    presence.on_router("far", True)
    losses = [lambda: presence.on_router("far", False), lambda: presence.on_plant("", False)]
    for lose in losses if router_first else reversed(losses):
        lose()
    presence.on_plant("", True)
    assert not presence.departure.wait(2.0 * PATIENCE)
    for lose in losses if router_first else reversed(losses):
        lose()
    assert presence.departure.wait(30.0)
    assert presence.reasons == ["the plant is not back at its router"]


def test_a_plant_that_leaves_a_router_has_left(presence) -> None:
    presence.on_router("", True)
    presence.on_plant("", False)
    assert presence.departure.wait(30.0)
    assert presence.reasons == ["the plant left"]
