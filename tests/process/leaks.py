"""A search for secrets in all that a run leaves behind."""

import base64
import io
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from mcap.stream_reader import StreamReader


def leaks(secrets: Mapping[str, bytes], texts: Mapping[str, bytes]) -> list[str]:
    """Return what was found where, for every secret in any of its spellings."""
    return [
        f"{secret} in {place}"
        for secret, value in secrets.items()
        for place, text in texts.items()
        if any(spelling in text for spelling in _spellings(value))
    ]


def files_of(folder: Path) -> dict[str, bytes]:
    """Return the content of every file in a folder, by its path there; recordings uncompressed."""
    files: Iterable[Path] = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): _content(path) for path in files}


def _content(path: Path) -> bytes:
    content = path.read_bytes()
    if path.suffix != ".mcap":
        return content
    records = StreamReader(io.BytesIO(content)).records
    return content + b"".join(getattr(record, "data", b"") for record in records)


def _spellings(secret: bytes) -> Iterator[bytes]:
    yield secret
    yield secret.hex().encode()
    yield repr(secret)[2:-1].encode()
    for encode in (base64.b64encode, base64.urlsafe_b64encode):
        yield encode(secret).rstrip(b"=")
