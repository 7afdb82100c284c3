"""Assignment of agents' places."""

import datetime

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from phalanx_plant.hub.joining import Places

from phalanx.hosts.authority import make_identities, public_der, signer
from phalanx.wire.keys import PLANT
from phalanx.wire.messages import PlaceRequest

MONTH = datetime.timedelta(days=30)
PROGRAMS = {"controller": ("1", "2"), "3": ("3",)}
ANN, BOB = (PlaceRequest(digest="d", public_key=key) for key in (b"Ann's", b"Bob's"))


class Desk:
    """Places, whose clock and vacancies a test sets."""

    def __init__(self) -> None:
        self.vacant, self.now = {"1": 0, "2": 0, "3": 0}, 0.0
        self.places = Places(
            PROGRAMS, lambda: self.vacant, "d", lambda name, _: name.encode(), lambda: self.now
        )

    def given(self, request: PlaceRequest) -> str:
        return self.places.answer(request).name


@pytest.fixture
def desk() -> Desk:
    return Desk()


def test_each_place_is_given_once(desk: Desk) -> None:
    carl = PlaceRequest(digest="d", public_key=b"Carl's")
    assert [desk.given(who) for who in (ANN, BOB, carl)] == ["controller", "3", ""]
    assert desk.given(ANN) == "controller", "who asks again gets what he has"
    assert desk.places.answer(BOB).certificate == b"3"


def test_a_controller_s_place_is_free_when_all_of_its_agents_are_missing(desk: Desk) -> None:
    desk.vacant = {"2": 0, "3": 0}
    assert desk.given(ANN) == "3"
    assert desk.given(BOB) == ""


def test_a_place_that_nobody_took_goes_to_the_next(desk: Desk) -> None:
    desk.vacant = {"3": 0}
    assert desk.given(ANN) == "3"
    desk.now = 19.0
    assert desk.given(BOB) == ""
    desk.now = 21.0
    assert desk.given(BOB) == "3"
    assert desk.given(ANN) == ""


def test_the_place_of_one_that_came_and_died_goes_to_the_next_at_once(desk: Desk) -> None:
    desk.vacant = {"3": 0}
    assert desk.given(ANN) == "3"
    desk.vacant = {"3": 1}
    assert desk.given(BOB) == "3"
    assert desk.given(ANN) == "", "who died does not come back"


def test_who_runs_another_scenario_gets_no_place(desk: Desk) -> None:
    answer = desk.places.answer(PlaceRequest(digest="e", public_key=b"Eve's"))
    assert not answer.name
    assert "--scenario" in answer.refusal
    assert desk.given(ANN) == "controller"


def test_the_certificate_says_the_name_for_that_key_alone(tmp_path) -> None:
    make_identities(tmp_path / "keys", [PLANT], ["here"], MONTH, claims=True)
    key = ec.generate_private_key(ec.SECP256R1())
    pem = signer(tmp_path / "keys" / PLANT)("3", public_der(key))
    signed = x509.load_pem_x509_certificate(pem)
    (name,) = signed.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    assert name.value == "3"
    assert signed.public_key() == key.public_key()
    ca = x509.load_pem_x509_certificate((tmp_path / "keys" / PLANT / "ca.crt").read_bytes())
    signed.verify_directly_issued_by(ca)
    assert signed.not_valid_after_utc == ca.not_valid_after_utc
    usage = signed.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert list(usage) == [x509.ExtendedKeyUsageOID.CLIENT_AUTH], "nobody listens with it"


@pytest.mark.parametrize("key", [b"", b"no key", b"\xff" * 91])
def test_what_is_no_key_gets_no_certificate(tmp_path, key: bytes) -> None:
    make_identities(tmp_path / "keys", [PLANT], ["here"], MONTH, claims=True)
    places = Places(PROGRAMS, lambda: {"3": 0}, "d", signer(tmp_path / "keys" / PLANT))
    assert "key" in places.answer(PlaceRequest(digest="d", public_key=key)).refusal
    good = public_der(ec.generate_private_key(ec.SECP256R1()))
    assert places.answer(PlaceRequest(digest="d", public_key=good)).name == "3"


def test_without_the_authoritys_key_nobody_is_given_a_certificate(tmp_path) -> None:
    make_identities(tmp_path / "keys", [PLANT], ["here"], MONTH)
    assert not (tmp_path / "keys" / PLANT / "ca.key").exists()
    with pytest.raises(ValueError, match="--claims"):
        signer(tmp_path / "keys" / PLANT)("3", b"")
