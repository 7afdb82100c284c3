"""Signatures of broadcasts: unlike a seal, a third agent can verify them.

A seal proves a broadcast to its receiver, which has the same key and could have made it. So a run
with safety.evidence gives each agent an Ed25519 key that no other has, and all the public keys.
"""

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import msgspec

from phalanx.wire.membership import Membership
from phalanx.wire.messages import SignedClaim

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import (
        Ed25519PrivateKey,
        Ed25519PublicKey,
    )

_SCHEMA = "phalanx claim 1"
"""Head of all that is signed: a signature of anything else is none of a claim."""


class Signatures:
    """Signs one agent's claims, and verifies those of all agents."""

    def __init__(self, membership: Membership, names: Sequence[str], i: int) -> None:
        """Sign as agent i of these names with its key in the membership."""
        self._membership, self._names, self._i = membership, names, i
        self._public = lru_cache(maxsize=None)(self._load)

    def sign(self, k: int, t_apply: float, u: tuple[float, ...]) -> SignedClaim:
        """Return the agent's own claim, signed."""
        claim = SignedClaim(self._i, k, t_apply, u)
        signature = self._private.sign(self.statement(claim))
        return msgspec.structs.replace(claim, signature=signature)

    def genuine(self, claim: SignedClaim) -> bool:
        """Return whether its sender signed a claim, for this run."""
        from cryptography.exceptions import InvalidSignature

        if not 0 <= claim.sender < len(self._names):
            return False
        try:
            self._public(claim.sender).verify(claim.signature, self.statement(claim))
        except InvalidSignature:
            return False
        return True

    def statement(self, claim: SignedClaim) -> bytes:
        """Return the bytes that are signed: two claims differ if and only if these do."""
        name = self._names[claim.sender]
        return msgspec.msgpack.encode(
            (_SCHEMA, self._membership.run, name, claim.k, claim.t_apply, claim.u)
        )

    @cached_property
    def _private(self) -> "Ed25519PrivateKey":
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

        return Ed25519PrivateKey.from_private_bytes(
            self._membership.signing_key(self._names[self._i])
        )

    def _load(self, sender: int) -> "Ed25519PublicKey":
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

        return Ed25519PublicKey.from_public_bytes(self._membership.public_key(self._names[sender]))
