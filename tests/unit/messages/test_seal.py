"""The seal: what is not a message of this run, on this key, is refused with its reason."""

import hashlib
import math
import struct
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.messages.keys import Keys, kind_and_name
from phalanx.messages.kinds import (
    MAX_BYTES,
    VERSION,
    Actuation,
    Broadcast,
    Ended,
    Message,
    Sample,
    Status,
    Telemetry,
)
from phalanx.messages.seal import Malformed, Sealer
from phalanx.messages.step_report import StepReport
from phalanx.network.inbox import DeliveryReport
from phalanx.theory.rows.origin import Origin

KEYS = Keys("run-1")
KEY = KEYS.telemetry("1")
SEALER = Sealer(b"secret")
TELEMETRY = Telemetry(
    k=7,
    report=StepReport(origin=Origin.QP, residual=-1e-9, u_nom=(1.5, -0.25), solve_time=1e-4),
    ages=((1, 0.012),),
    fates=(DeliveryReport(1, 6, 0.003),),
    rejected=2,
)


def report_with(**changes: Any) -> StepReport:
    return msgspec.structs.replace(TELEMETRY.report, **changes)


ACTUATION = Actuation(k=7, t_apply=0.07, u=(1.5, -0.25))
MESSAGES: list[Message] = [
    TELEMETRY,
    ACTUATION,
    Broadcast(k=7, t_apply=0.07, u=(1.5, -0.25)),
    Sample(
        k=3,
        t=0.03,
        seen=(0, 1, 2),
        x=b"\0" * 24,
        senders=(0, 2),
        since=(0, 3),
        latest=(2, 3),
        hearers=(1,),
    ),
    Status(t=1.0, real_time_factor=24.0, steps=100, backups=3, waiting_for=("1", "2")),
    Ended(summary=b"{}"),
]
kinds = st.sampled_from([type(message) for message in MESSAGES])


def reason(payload: bytes, key: str = KEY, kind: type = Telemetry, sealer: Sealer = SEALER) -> str:
    with pytest.raises(Malformed) as refusal:
        sealer.open(key, payload, kind)
    return str(refusal.value)


def forged(body: bytes, key: str = KEY) -> bytes:
    """A body of our choice under a valid seal: what a holder of the secret could send."""
    secret = hashlib.blake2b(b"secret", digest_size=32).digest()
    return hashlib.blake2b(key.encode() + body, key=secret, digest_size=16).digest() + body


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
@pytest.mark.parametrize("secret", [b"", b"secret", b"x" * 100])
def test_a_sealed_message_opens_as_it_was(message, secret):
    sealer = Sealer(secret)
    assert sealer.open(KEY, sealer.seal(KEY, message), type(message)) == message


@given(k=st.integers(0, 2**62), u=st.lists(st.floats(-1e300, 1e300)))
def test_numbers_pass_the_wire_bit_for_bit(k, u):
    message = msgspec.structs.replace(ACTUATION, k=k, u=tuple(u))
    again = SEALER.open(KEY, SEALER.seal(KEY, message), Actuation)
    assert again.k == k
    assert [a.hex() for a in again.u] == [a.hex() for a in u]


@pytest.mark.parametrize("sealer", [SEALER, Sealer()], ids=["a secret", "no secret"])
def test_every_flipped_bit_is_refused_even_without_a_secret(sealer):
    payload = sealer.seal(KEY, TELEMETRY)
    for bit in range(8 * len(payload)):
        flipped = bytearray(payload)
        flipped[bit // 8] ^= 1 << bit % 8
        assert reason(bytes(flipped), sealer=sealer) == "bad seal"


@pytest.mark.parametrize(
    "key", [KEYS.telemetry("2"), KEYS.sample("1"), Keys("run-2").telemetry("1"), "", KEY + "/"]
)
def test_a_message_for_another_key_or_run_is_refused(key):
    assert reason(SEALER.seal(KEY, TELEMETRY), key) == "bad seal"


@pytest.mark.parametrize("secret", [b"", b"Secret", b"secret\0"])
def test_a_message_under_another_secret_is_refused(secret):
    assert reason(Sealer(secret).seal(KEY, TELEMETRY)) == "bad seal"


def test_an_oversized_payload_is_refused_unseen():
    summary = Ended(summary=b"x" * MAX_BYTES)
    assert reason(SEALER.seal(KEY, summary), kind=Ended) == "oversized"


def test_the_largest_payload_allowed_opens():
    seal_and_head = len(SEALER.seal(KEY, Ended(summary=b"x" * 60_000))) - 60_000
    message = Ended(summary=b"x" * (MAX_BYTES - seal_and_head))
    payload = SEALER.seal(KEY, message)
    assert len(payload) == MAX_BYTES
    assert SEALER.open(KEY, payload, Ended) == message


def test_every_truncation_is_refused():
    payload = SEALER.seal(KEY, TELEMETRY)
    reasons = {reason(payload[:length]) for length in range(len(payload))}
    assert reasons == {"truncated", "bad seal"}
    assert reason(payload[:16]) == "truncated"


def test_another_version_is_refused():
    newer = msgspec.structs.replace(TELEMETRY, version=VERSION + 1)
    assert reason(SEALER.seal(KEY, newer)) == "other version"


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("message", "change"),
    [
        (ACTUATION, lambda v: {"t_apply": v}),
        (ACTUATION, lambda v: {"u": (1.0, v)}),
        (MESSAGES[2], lambda v: {"t_apply": v}),
        (MESSAGES[2], lambda v: {"u": (1.0, v)}),
        (TELEMETRY, lambda v: {"report": report_with(residual=v)}),
        (TELEMETRY, lambda v: {"report": report_with(u_nom=(1.0, v))}),
        (TELEMETRY, lambda v: {"report": report_with(solve_time=v)}),
        (TELEMETRY, lambda v: {"ages": ((1, v),)}),
        (TELEMETRY, lambda v: {"fates": (DeliveryReport(1, 6, v),)}),
    ],
)
def test_numbers_that_are_not_finite_are_refused(message, change, bad):
    """JSON has no NaN: one that got into the recording would make it unreadable."""
    payload = SEALER.seal(KEY, msgspec.structs.replace(message, **change(bad)))
    assert reason(payload, kind=type(message)) == "not finite"


@pytest.mark.parametrize(
    ("message", "change", "most"),
    [
        (MESSAGES[1], lambda v: {"t_apply": v}, 1e300),
        (MESSAGES[2], lambda v: {"t_apply": v}, 1e300),
        (TELEMETRY, lambda v: {"report": report_with(residual=v)}, 1e303),
    ],
)
def test_numbers_of_which_figures_would_be_infinite_are_refused(message, change, most):
    for value in (1.001 * most, -1.7e308):
        payload = SEALER.seal(KEY, msgspec.structs.replace(message, **change(value)))
        assert reason(payload, kind=type(message)) == "too large"
    borne = msgspec.structs.replace(message, **change(most))
    assert SEALER.open(KEY, SEALER.seal(KEY, borne), type(message)) == borne


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_they_are_refused_in_half_the_bits_too(bad):
    body = msgspec.msgpack.encode(
        msgspec.structs.replace(TELEMETRY, report=report_with(solve_time=0.625))
    )
    whole, half = (b"\xcb" + struct.pack(">d", 0.625), b"\xca" + struct.pack(">f", bad))
    assert body.count(whole) == 1
    assert reason(forged(body.replace(whole, half))) == "not finite"


def test_a_finite_number_with_bytes_as_of_an_infinite_one_is_accepted():
    (chance,) = struct.unpack(">d", b"\x40\xcb\x7f\xf0\0\0\0\0")
    message = msgspec.structs.replace(TELEMETRY, report=report_with(residual=chance))
    assert SEALER.open(KEY, SEALER.seal(KEY, message), Telemetry) == message


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (msgspec.msgpack.encode([VERSION, 7]), "wrong fields"),
        (msgspec.msgpack.encode([VERSION, "seven", *range(8)]), "wrong fields"),
        (msgspec.msgpack.encode({"version": VERSION}), "wrong fields"),
        (msgspec.msgpack.encode(5), "wrong fields"),
        (msgspec.msgpack.encode([VERSION, *[None] * 40]), "wrong fields"),
        (b"\xc1", "not msgpack"),
        (b"\x91" * 5000, "wrong fields"),
        (msgspec.msgpack.encode(TELEMETRY)[:-1], "not msgpack"),
        (msgspec.msgpack.encode(TELEMETRY) + b"\0", "not msgpack"),
    ],
)
def test_a_well_sealed_body_that_is_no_message_is_refused(body, expected):
    assert reason(forged(body)) == expected


def test_the_forged_seal_of_these_tests_is_a_valid_one():
    assert SEALER.open(KEY, forged(msgspec.msgpack.encode(TELEMETRY)), Telemetry) == TELEMETRY


def test_an_unknown_origin_is_refused():
    body = msgspec.msgpack.encode(TELEMETRY).replace(b"\xa2qp", b"\xa2zz")
    assert reason(forged(body)) == "wrong fields"


@given(st.binary(min_size=1, max_size=300), kinds)
@settings(max_examples=300)
def test_noise_is_malformed_and_nothing_else_sealed_or_not(noise, kind):
    for payload in (noise, forged(noise)):
        with pytest.raises(Malformed):
            SEALER.open(KEY, payload, kind)


@pytest.mark.slow
@given(st.integers(0, len(MESSAGES) - 1), st.integers(0, 255), st.integers(0, 400))
@settings(max_examples=300)
def test_a_message_altered_by_one_who_holds_the_secret_is_a_message_or_malformed(which, byte, at):
    body = bytearray(msgspec.msgpack.encode(MESSAGES[which]))
    body[at % len(body)] = byte
    kind = type(MESSAGES[which])
    try:
        message = SEALER.open(KEY, forged(bytes(body)), kind)
    except Malformed:
        return
    assert type(message) is kind


def test_keys_have_the_kind_and_the_sender_at_a_fixed_depth():
    assert KEY == "phalanx/run-1/telemetry/1"
    assert kind_and_name(KEY) == ("telemetry", "1")
    assert kind_and_name(KEYS.sample("4")) == ("sample", "4")
    assert kind_and_name(KEYS.alive("plant", "0a1b")) == ("alive", "plant")
    assert kind_and_name("phalanx/run-1") == ("", "")
