"""The records of an MCAP file in order, its chunks unpacked within bounds.

A few kilobytes of zstd can stand for terabytes, and the file's own word for how many is not to be
believed. What a recording of that length cannot hold is damage.
"""

from collections.abc import Iterator
from io import BytesIO

from mcap.exceptions import McapError
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import StreamReader, breakup_chunk
from zstandard import frame_content_size

_MOST_OF_A_CHUNK = 4 * 2**20
"""A chunk is written when it holds 64 kB: one record more makes it longer, and none is so long."""
_LEAST_ALLOWED, _DENSEST = 16 * 2**20, 100
"""All chunks together hold so many bytes, or so many times the file, if that is more."""


class OverfullError(McapError):
    """Chunks that unpack to more than a recording holds."""


def records_of(file: bytes) -> Iterator[McapRecord]:
    """Every record, with checksums compared.

    Raises what mcap, zstandard and struct do, and OverfullError.
    """
    left = max(_LEAST_ALLOWED, _DENSEST * len(file))
    # In memory: where a flipped bit makes a length a terabyte, a file would set that much aside.
    for record in StreamReader(BytesIO(file), emit_chunks=True, validate_crcs=True).records:
        if not isinstance(record, Chunk):
            yield record
            continue
        left -= _unpacked(record)
        if left < 0:
            raise OverfullError("chunks that unpack to more than a recording holds")
        yield from breakup_chunk(record, validate_crc=True)


def _unpacked(chunk: Chunk) -> int:
    """How many bytes a chunk unpacks to at most. Raises OverfullError."""
    sizes = [chunk.uncompressed_size]
    if chunk.compression == "zstd":
        # The frame's own word counts for zstd, whatever the chunk says; -1 where it says nothing.
        sizes.append(frame_content_size(chunk.data))
    if max(sizes) > _MOST_OF_A_CHUNK:
        raise OverfullError(f"a chunk that unpacks to {max(sizes)} bytes")
    return max(sizes)
