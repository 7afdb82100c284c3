"""Signatures of broadcasts and reveals: unlike a seal, a third agent can verify them.

A seal proves a broadcast to its receiver, which has the same key and could have made it. So a run
with safety.evidence gives each agent an Ed25519 key that no other has, and all the public keys.
"""

import hashlib
from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, TypeVar

import msgspec

from phalanx.wire.membership import Membership
from phalanx.wire.messages import AuditedClaim, Reveal, SignedClaim

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import (
        Ed25519PrivateKey,
        Ed25519PublicKey,
    )

_Signed = TypeVar("_Signed", SignedClaim, Reveal)
_SCHEMA, _OF_REVEAL = "phalanx claim 1", "phalanx reveal 1"
"""Heads of all that is signed: a signature of anything else is none of a claim or a reveal."""


class Signatures:
    """Signs one agent's claims and reveals, and verifies those of all agents."""

    def __init__(self, membership: Membership, names: Sequence[str], i: int) -> None:
        """Sign as agent i of these names with its key in the membership."""
        self._membership, self._names, self._i = membership, names, i
        self._public = lru_cache(maxsize=None)(self._load)

    def sign(
        self, k: int, t_apply: float, u: tuple[float, ...], digest: bytes = b""
    ) -> SignedClaim:
        """Return the agent's own claim, signed; digest: of its reveal, if it may be audited."""
        claim = SignedClaim(self._i, k, t_apply, u)
        if digest:
            claim = AuditedClaim(self._i, k, t_apply, u, digest=digest)
        signature = self._private.sign(self.statement(claim))
        return msgspec.structs.replace(claim, signature=signature)

    def sign_reveal(self, reveal: Reveal) -> Reveal:
        """Return the agent's own reveal, signed."""
        signature = self._private.sign(self._commitment(reveal))
        return msgspec.structs.replace(reveal, signature=signature)

    def genuine(self, claim: SignedClaim) -> bool:
        """Return whether its sender signed a claim, for this run."""
        return self._verified(claim, self.statement)

    def genuine_reveal(self, reveal: Reveal) -> bool:
        """Return whether its sender signed a reveal, for this run."""
        return self._verified(reveal, self._commitment)

    def statement(self, claim: SignedClaim) -> bytes:
        """Return the bytes that are signed: two claims differ if and only if these do."""
        name = self._names[claim.sender]
        stated = (_SCHEMA, self._membership.run, name, claim.k, claim.t_apply, claim.u)
        if isinstance(claim, AuditedClaim):
            return msgspec.msgpack.encode((*stated, claim.digest))
        return msgspec.msgpack.encode(stated)

    def _commitment(self, reveal: Reveal) -> bytes:
        name = self._names[reveal.sender]
        return msgspec.msgpack.encode((_OF_REVEAL, self._membership.run, name, digest_of(reveal)))

    def _verified(self, signed: _Signed, statement: Callable[[_Signed], bytes]) -> bool:
        from cryptography.exceptions import InvalidSignature

        if not 0 <= signed.sender < len(self._names):
            return False
        try:
            self._public(signed.sender).verify(signed.signature, statement(signed))
        except InvalidSignature:
            return False
        return True

    @cached_property
    def _private(self) -> "Ed25519PrivateKey":
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

        return Ed25519PrivateKey.from_private_bytes(
            self._membership.signing_key(self._names[self._i])
        )

    def _load(self, sender: int) -> "Ed25519PublicKey":
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

        return Ed25519PublicKey.from_public_bytes(self._membership.public_key(self._names[sender]))


def digest_of(reveal: Reveal) -> bytes:
    """Return the digest of a reveal without its signature, 32 bytes."""
    unsigned = msgspec.structs.replace(reveal, signature=b"") if reveal.signature else reveal
    return hashlib.blake2b(msgspec.msgpack.encode(unsigned), digest_size=32).digest()
