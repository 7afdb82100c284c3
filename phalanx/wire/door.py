"""What comes to a receiver damaged: the payload as it was, but for a byte flipped on its way."""

from phalanx.network.inbox import SentInput
from phalanx.wire.keys import Keys
from phalanx.wire.messages import Broadcast
from phalanx.wire.seal import Sealer


class Door:
    """Where an agent takes payloads in."""

    def __init__(self, keys: Keys, sealer: Sealer) -> None:
        self._keys, self._sealer = keys, sealer

    def open_damaged(self, sender: str, receiver: str, message: SentInput) -> Broadcast:
        """Open a broadcast's payload after a byte of it was flipped.

        Sealing is a function: the payload made here is the one that the sender put. Raises
        Malformed, as every seal does that is worth its name.
        """
        sent = Broadcast(k=message.k, t_apply=message.t_apply, u=message.u)
        key = self._keys.broadcast(sender, receiver)
        payload = bytearray(self._sealer.seal(key, sent))
        # Knuth's multiplier: another byte and other bits for each number, the same every time.
        place = message.k * 2654435761
        payload[place % len(payload)] ^= 1 + place % 255
        return self._sealer.open(key, bytes(payload), Broadcast)
