"""mcap writes each field of a message by calls of its own: a quarter of a plant's calls in a step.

Upstream: mcap 1.6, `mcap.records.Message.write`, `mcap.records.MessageIndex.write` and
`mcap._chunk_builder`.
"""

import struct

from mcap._chunk_builder import ChunkBuilder
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Message, MessageIndex
from mcap.writer import Writer

_HEAD = struct.Struct("<BQHIQQ")
_LENGTH = _HEAD.size - 9
"""Of a message's record without its data, after operation code and length [bytes]."""


class PackedIndex(MessageIndex):
    """The index of a chunk's messages, written at once, with the same bytes."""

    def write(self, stream: RecordBuilder) -> None:
        """Append the index: a pair of time and offset for each message."""
        numbers = [number for record in self.records for number in record]
        size = 8 * len(numbers)
        head = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + size, self.channel_id, size)
        stream._buffer.write(head + struct.pack(f"<{len(numbers)}Q", *numbers))


class PackedChunk(ChunkBuilder):
    """A chunk that gets each message by one write, with the same bytes."""

    def add_message(self, message: Message) -> None:
        """Append a message, and enter it in the chunk's index."""
        at, channel, data = message.log_time, message.channel_id, message.data
        first, buffer = not self.num_messages, self.record_writer._buffer
        if first or at < self.message_start_time:
            self.message_start_time = at
        if at > self.message_end_time:
            self.message_end_time = at
        index = self.message_indices.get(channel)
        if index is None:
            index = self.message_indices[channel] = PackedIndex(channel_id=channel, records=[])
        index.records.append((at, buffer.tell()))
        self.num_messages += 1
        size = _LENGTH + len(data)
        head = _HEAD.pack(Opcode.MESSAGE, size, channel, message.sequence, at, message.publish_time)
        buffer.write(head + data)


def pack_messages(writer: Writer) -> None:
    """Have a writer that has written nothing yet pack its messages."""
    writer._Writer__chunk_builder = PackedChunk()  # type: ignore[attr-defined]
