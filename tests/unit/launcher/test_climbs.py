"""Climbs of a scenario's walk: calls from a room into one that it may not import."""

import sys
from collections.abc import Iterator
from types import CodeType, FrameType
from typing import Any

import pytest

import phalanx
from tests.unit.test_imports import BY_ALL, MAY_IMPORT, PACKAGES, room_of


def module(frame: FrameType) -> str:
    return frame.f_globals.get("__name__", "")


def ours(frame: FrameType | None) -> FrameType | None:
    """The frame, or the nearest that called it, of a module of the project."""
    while frame is not None and module(frame).split(".")[0] not in PACKAGES:
        frame = frame.f_back
    return frame


def codes(value: Any) -> Iterator[CodeType | None]:
    """Code that runs if a value is called, or gone through."""
    for name in ("__func__", "func", "__wrapped__", "__func__"):
        value = getattr(value, name, value)
    yield getattr(value, "__code__", None) or getattr(value, "gi_code", None)
    if isinstance(value, type):
        yield getattr(value.__init__, "__code__", None)
    for part in value if isinstance(value, tuple) else ():
        yield from codes(part)


def climbs(scenario: str) -> set[tuple[str, str]]:
    """Pairs of rooms of a short run, the lower first. A function handed in for a call is none."""
    pairs = set()

    def see(frame: FrameType, event: str, _: object) -> None:
        if event != "call" or ours(frame) is not frame or frame.f_code.co_name == "<module>":
            return
        if (caller := ours(frame.f_back)) is None:
            return
        below, above = room_of(module(caller)), room_of(module(frame))
        if above not in MAY_IMPORT[below] | BY_ALL | {below}:
            handed = (code for value in caller.f_locals.values() for code in codes(value))
            if frame.f_code not in handed:
                pairs.add((below, above))

    sys.setprofile(see)
    try:
        phalanx.run(phalanx.load(scenario, {"duration": 0.06}), engine="in-process")
    finally:
        sys.setprofile(None)
    return pairs


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["unicycles", "crossing-radio"])
def test_a_scenarios_walk_climbs_at_few_places(scenario):
    pairs = climbs(scenario)
    print(f"{scenario} climbs {len(pairs)} times: {sorted(pairs)}")
    assert 0 < len(pairs) <= 8
