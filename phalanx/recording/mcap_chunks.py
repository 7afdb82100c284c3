"""mcap writes each field of a message by calls of its own: a quarter of a plant's calls in a step.

Upstream: mcap 1.6, `mcap.writer.Writer.add_message`, `mcap.records.Message.write`,
`mcap.records.MessageIndex.write` and `mcap._chunk_builder`.
"""

import struct
from collections import defaultdict
from collections.abc import Iterable
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import MessageIndex
from mcap.writer import Writer

_HEAD = struct.Struct("<BQHIQQ")
_LENGTH = _HEAD.size - 9
"""Of a message's record without its data, after operation code and length [bytes]."""


class _PackedIndex(MessageIndex):
    """The index of a chunk's messages, written at once: a time and an offset for each."""

    def write(self, stream: RecordBuilder) -> None:
        numbers: list[Any] = self.records
        size = 8 * len(numbers)
        head = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + size, self.channel_id, size)
        stream.write(head + struct.pack(f"<{len(numbers)}Q", *numbers))


class PackedWriter(Writer):
    """A writer that makes its files with few calls for each message, with the same bytes."""

    def __init__(self, output: Any, chunk_size: int) -> None:
        super().__init__(output, chunk_size=chunk_size, enable_data_crcs=True)
        self._chunk: Any = self._Writer__chunk_builder  # type: ignore[attr-defined]
        self._most = chunk_size
        self._begin_chunk()

    def _begin_chunk(self) -> None:
        self._parts: list[bytes] = []
        self._index: defaultdict[int, list[int]] = defaultdict(list)
        """By channel, time [ns] and offset of each message, one after the other."""
        self._size = 0
        """Of the messages [bytes]."""

    def add(self, messages: Iterable[tuple[int, int, bytes]]) -> None:
        """Append messages: channel, time [ns] and data of each."""
        for channel, at, data in messages:
            if not self._parts:
                self._size = self._chunk.count
            size = _LENGTH + len(data)
            self._parts += _HEAD.pack(Opcode.MESSAGE, size, channel, 0, at, at), data
            self._index[channel] += at, self._size
            self._size += 9 + size
            if self._size > self._most:
                self._Writer__finalize_chunk()

    def _Writer__finalize_chunk(self) -> None:  # noqa: N802
        """Hand the chunk's messages to the library, which writes it, and count them."""
        if not self._parts:
            return
        chunk, statistics = self._chunk, self._Writer__statistics  # type: ignore[attr-defined]
        chunk.record_writer.write(b"".join(self._parts))
        times = [at for numbers in self._index.values() for at in numbers[::2]]
        chunk.message_start_time, chunk.message_end_time = min(times), max(times)
        chunk.num_messages = len(times)
        if not statistics.message_count or min(times) < statistics.message_start_time:
            statistics.message_start_time = min(times)
        statistics.message_end_time = max(statistics.message_end_time, max(times))
        statistics.message_count += len(times)
        for channel, numbers in self._index.items():
            chunk.message_indices[channel] = _PackedIndex(channel, numbers)  # type: ignore[arg-type]
            statistics.channel_message_counts[channel] += len(numbers) // 2
        self._begin_chunk()
        super()._Writer__finalize_chunk()  # type: ignore[misc]
