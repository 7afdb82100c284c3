"""Recordings: exact, readable after any cut, honest about damage."""

import contextlib
import io
import os
import re
import resource
import signal
import struct
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType
from zstandard import ZstdCompressor

from phalanx.faults.commands import Command, CommandKind
from phalanx.guarantee.verdict import Outcome
from phalanx.recording.read import Recording, UnreadableRecordingError, read
from phalanx.recording.records import RECORDING, SUMMARY, Log, State, Step, StepData
from phalanx.recording.write import Record, RecordingError, RecordingWriter, write_summary
from phalanx.scenario.load import load
from phalanx.scenario.model import Scenario, digest
from phalanx.theory.rows.origin import Origin
from tests.unit.report.recordings import summary_of


@cache
def scenario() -> Scenario:
    return load("unicycles", seed=5)


FIGURES = summary_of(load("unicycles", seed=5))
COUNT = 900


@cache
def records(count: int = COUNT) -> list[State | Step | Log]:
    """States and steps as a run might leave them, and one line of the log."""
    rng = np.random.default_rng(1)
    lines: list[State | Step | Log] = []
    for k in range(count):
        t = 0.002 * k + float(rng.uniform(0, 1e-3))
        lines.append(State(t, rng.normal(size=15).tolist(), *rng.normal(size=2).tolist()))
        u = tuple(rng.normal(size=2).tolist())
        fates = [("2", k, -1.0), ("3", k, float(rng.uniform()))]
        ages = [("2", float(rng.uniform()))]
        step = Step(
            agent="1", k=k, t=t, t_apply=t, u=u, origin=Origin.QP, residual=-1e-9, solve_time=1e-4,
            ages=ages, fates=fates,
        )  # fmt: skip
        lines.append(step)
    lines.append(Log(0.002 * count, "agent 3 said ψ"))
    return lines


def write(path: Path, *written: Record, finish: bool = True) -> Path:
    """Write these records, by default `records`."""
    with RecordingWriter(path, scenario(), "run-1") as writer:
        for record in written or records():
            writer.write(record)
        if finish:
            writer.finish(FIGURES)
    return path


class Whole(bytes):
    """The bytes of a recording, which a failing test shall not print."""

    def __repr__(self) -> str:
        return f"<{len(self)} bytes>"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """A finished recording of several chunks."""
    return Whole(write(tmp_path_factory.mktemp("whole") / RECORDING).read_bytes())


def spans(recording: bytes) -> list[tuple[int, int, int]]:
    """(opcode, begin, end) of every record in the file."""
    at, extents = 8, []
    while at < len(recording) - 8:
        end = at + 9 + int.from_bytes(recording[at + 1 : at + 9], "little")
        extents.append((recording[at], at, end))
        at = end
    return extents


CHUNK, DATA_END = 0x06, 0x0F


def chunks(recording: bytes) -> list[tuple[int, int]]:
    return [(begin, end) for opcode, begin, end in spans(recording) if opcode == CHUNK]


def reread(folder: Path, content: bytes) -> Recording:
    path = folder / "again.mcap"
    path.write_bytes(content)
    return read(path)


def assert_is_a_beginning(recording: Recording) -> None:
    """Every record is one that was written, and they are the first ones."""
    states = [r for r in records() if isinstance(r, State)]
    steps = [r for r in records() if isinstance(r, Step)]
    assert recording.states == states[: len(recording.states)]
    assert recording.steps == steps[: len(recording.steps)]


def test_what_was_written_is_read_bit_for_bit(whole, tmp_path):
    assert len(chunks(whole)) >= 4
    recording = reread(tmp_path, whole)
    assert recording.damage is None
    assert recording.scenario == scenario()
    assert recording.metadata["seed"] == "5"
    assert recording.metadata["run"] == "run-1"
    assert recording.metadata["scenario_digest"] == digest(scenario())
    assert recording.summary == FIGURES
    assert recording.log == [r for r in records() if isinstance(r, Log)]
    assert (len(recording.states), len(recording.steps)) == (COUNT, COUNT)
    assert_is_a_beginning(recording)
    written = np.array([r.x for r in records() if isinstance(r, State)])
    assert recording.x.tobytes() == written.tobytes()
    assert recording.x.shape == (COUNT, 15)
    assert len(recording.times) == len(recording.h_tot) == COUNT


def test_mcaps_own_reader_reads_it(whole, tmp_path):
    path = tmp_path / RECORDING
    path.write_bytes(whole)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        topics = [channel.topic for _, channel, _ in reader.iter_messages()]
        times = [message.log_time for *_, message in reader.iter_messages()]
        schemas = {s.name: s.encoding for s in reader.get_summary().schemas.values()}
        statistics = reader.get_summary().statistics
        attached = {a.name for a in reader.iter_attachments()}
    assert (statistics.message_start_time, statistics.message_end_time) == (min(times), max(times))
    assert (topics.count("/state"), topics.count("/step"), topics.count("/log")) == (900, 900, 1)
    kinds = [f"phalanx.{name}" for name in ("State", "Step", "Shown", "Log", "Command")]
    assert schemas == dict.fromkeys(kinds, "jsonschema")
    assert attached == {"scenario.json", "summary.json"}


@pytest.mark.slow
@given(share=st.floats(0.0, 1.0, exclude_max=True))
@settings(max_examples=20)
def test_a_file_cut_anywhere_gives_all_of_its_whole_chunks_and_says_so(whole, tmp_path, share):
    cut = int(share * len(whole))
    first_chunk = chunks(whole)[0][0]
    if cut < first_chunk:
        assert_damaged(tmp_path, whole[:cut])
        return
    recording = reread(tmp_path, whole[:cut])
    assert "cut short" in (recording.damage or "")
    assert_is_a_beginning(recording)
    count = len(recording.states) + len(recording.steps) + len(recording.log)
    assert count == messages_before(whole, cut)
    if recording.states:
        assert f"t = {recording.states[-1].t:.3f} s" in recording.damage


def messages_before(whole: bytes, cut: int) -> int:
    """Count the messages in whole chunks before the cut, by the indexes in the file."""
    reader, count = StreamReader(io.BytesIO(whole), emit_chunks=True), 0
    for (_, end), record in zip(
        chunks(whole), (r for r in reader.records if isinstance(r, Chunk)), strict=True
    ):
        if end <= cut:
            count += sum(isinstance(r, Message) for r in breakup_chunk(record))
    return count


bits = st.integers(0, 7)
shares = st.floats(0.0, 1.0, exclude_max=True)
CHUNK_LENGTH = 9 + 8 + 8 + 8 + 4 + 8
"""Where a chunk says how long its data are: after opcode, length, first and last time, size,
checksum and "zstd"."""
CHUNK_HEAD = CHUNK_LENGTH + 8
"""Bytes of a chunk before its data."""


def flipped(whole: bytes, at: int, bit: int) -> bytes:
    content = bytearray(whole)
    content[at] ^= 1 << bit
    return bytes(content)


@pytest.mark.slow
@given(chunk=st.integers(0, 3), share=shares, bit=bits)
@settings(max_examples=25)
def test_a_flipped_bit_inside_a_chunk_is_damage_and_nothing_it_altered_is_taken(
    whole, tmp_path, chunk, share, bit
):
    """A few bits mean nothing to zstd: then the file's checksum alone tells of the damage."""
    begin, end = chunks(whole)[chunk]
    at = begin + CHUNK_HEAD + int(share * (end - begin - CHUNK_HEAD))
    recording = reread(tmp_path, flipped(whole, at, bit))
    assert recording.damage is not None
    assert_is_a_beginning(recording)
    count = len(recording.states) + len(recording.steps) + len(recording.log)
    before = messages_before(whole, begin)
    assert count == (len(records()) if still_decodes(whole, at, bit, chunk) else before)


@pytest.mark.parametrize("byte", range(8))
def test_a_chunk_that_says_it_is_longer_than_the_file_is_damage_and_takes_no_memory(
    whole, tmp_path, byte
):
    begin, _ = chunks(whole)[1]
    recording = reread(tmp_path, flipped(whole, begin + CHUNK_LENGTH + byte, 7))
    assert recording.damage is not None
    assert_is_a_beginning(recording)


def still_decodes(whole: bytes, at: int, bit: int, chunk: int) -> bool:
    """Return whether the chunk with this bit flipped still has the same content."""
    begin, _ = chunks(whole)[chunk]
    before, after = (
        Chunk.read(ReadDataStream(io.BytesIO(content[begin + 9 :])))
        for content in (whole, flipped(whole, at, bit))
    )
    try:
        return [*breakup_chunk(after, validate_crc=True)] == [*breakup_chunk(before)]
    except Exception:  # of any kind: it is zstd's, or of whatever it made of the bytes
        return False


@pytest.mark.slow
@given(share=shares, bit=bits)
@settings(max_examples=30)
def test_a_flipped_bit_anywhere_in_the_data_is_never_silently_accepted(whole, tmp_path, share, bit):
    """The index behind the data is a convenience: nothing is read from it."""
    data_end = next(begin for opcode, begin, _ in spans(whole) if opcode == DATA_END)
    assert_damaged(tmp_path, flipped(whole, int(share * data_end), bit))


@pytest.mark.parametrize("byte", range(9))
@pytest.mark.parametrize("bit", [0, 3, 7])
def test_a_flipped_bit_in_the_head_of_a_chunk_does_not_hide_the_chunk(whole, tmp_path, byte, bit):
    """An unknown opcode makes a reader skip the record."""
    assert_damaged(tmp_path, flipped(whole, chunks(whole)[2][0] + byte, bit))


def assert_damaged(folder: Path, content: bytes) -> None:
    """It is either no recording at all, or one that says what is wrong."""
    with contextlib.suppress(UnreadableRecordingError):
        assert reread(folder, content).damage is not None


def test_a_run_that_was_killed_leaves_a_recording_without_summary(tmp_path):
    recording = read(write(tmp_path / RECORDING, finish=False))
    assert recording.summary is None
    assert "cut short" in (recording.damage or "")
    assert len(recording.states) > COUNT // 2


def test_a_verdict_counts_only_at_the_end_of_a_whole_recording(whole, tmp_path):
    """The last chunk is written behind it: what a run that broke then leaves has none."""
    last, _ = chunks(whole)[-1]
    assert b"summary.json" in whole[:last]
    for cut in (last, last + 100, len(whole) - 1):
        recording = reread(tmp_path, whole[:cut])
        assert recording.summary is None
        assert recording.unfinished == recording.damage
    assert reread(tmp_path, whole).unfinished == ""


def test_where_no_pair_counts_any_more_no_h_is_the_worst(tmp_path):
    states = State(0.0, [0.0] * 15, 1.0, -0.5), State(0.1, [0.0] * 15, 2.0, -np.inf)
    write(tmp_path / RECORDING, *states)
    assert read(tmp_path).h.tolist() == [-0.5, -np.inf]


def test_what_is_no_recording_is_refused_by_name(tmp_path):
    (tmp_path / "noise.mcap").write_bytes(os.urandom(100))
    (tmp_path / "empty.mcap").write_bytes(b"")
    for name in ("noise.mcap", "empty.mcap", "absent.mcap"):
        with pytest.raises(UnreadableRecordingError, match=name):
            read(tmp_path / name)


def test_a_recording_is_never_written_over(tmp_path):
    path = write(tmp_path / RECORDING)
    before = path.read_bytes()
    with pytest.raises(RecordingError, match=r"recording\.mcap"):
        RecordingWriter(path, scenario(), "run-2")
    assert path.read_bytes() == before


def test_a_folder_that_is_gone_is_named(tmp_path):
    with pytest.raises(RecordingError, match="gone"):
        RecordingWriter(tmp_path / "gone" / RECORDING, scenario(), "run-1")


@contextlib.contextmanager
def full_disk(limit: int) -> Iterator[None]:
    """No file of this process grows beyond so many bytes."""
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("share", [0.4, 0.7, 0.9])
def test_a_full_disk_is_an_error_that_names_the_file_and_leaves_it_readable(whole, tmp_path, share):
    """A limit on file size is the full disk that needs no root: a write fails half way."""
    path, limit = tmp_path / RECORDING, int(share * len(whole))
    with pytest.raises(RecordingError, match=re.escape(str(path))), full_disk(limit):
        write(path)
    assert path.stat().st_size <= limit
    recording = read(path)
    assert recording.scenario == scenario()
    assert "cut short" in (recording.damage or "")
    assert_is_a_beginning(recording)
    assert spans(path.read_bytes() + bytes(8))[-1][2] == path.stat().st_size, "half a record"
    whole_chunks = [end for _, end in chunks(whole) if end <= limit]
    assert path.stat().st_size >= whole_chunks[-1]
    assert len(recording.states) > 0


def test_behind_a_write_that_failed_nothing_is_written(whole, tmp_path):
    """Room may come again: a later chunk is not to follow one that is missing, or zeros."""
    path = tmp_path / RECORDING
    with RecordingWriter(path, scenario(), "run-1") as writer:
        with contextlib.suppress(RecordingError), full_disk(int(0.5 * len(whole))):
            for record in records():
                writer.write(record)
        beginning = path.read_bytes()
        with pytest.raises(RecordingError, match=re.escape(str(path))):
            writer.finish(FIGURES)
    assert path.read_bytes() == beginning
    assert "cut short" in (read(path).damage or "")


def bomb(
    whole: bytes, chunks_of: int, copies: int, *, honest: bool = True, sized: bool = True
) -> bytes:
    """A recording with chunks of one record of zeros put before its last records.

    honest: a chunk says its size. sized: so does the frame in it.
    """
    packer = ZstdCompressor(level=1).compressobj(chunks_of if sized else -1)
    packed = packer.compress(b"\x80" + struct.pack("<Q", chunks_of - 9))
    for size in [2**20] * (chunks_of // 2**20 - 1) + [2**20 - 9]:
        packed += packer.compress(bytes(size))
    packed += packer.flush()
    claimed_size = chunks_of if honest else 1000
    chunk = b"".join(
        [
            struct.pack("<QQQI", 0, 0, claimed_size, 0),
            struct.pack("<I", 4) + b"zstd",
            struct.pack("<Q", len(packed)) + packed,
        ]
    )
    data_end = next(begin for opcode, begin, _ in spans(whole) if opcode == DATA_END)
    record = bytes([Opcode.CHUNK]) + struct.pack("<Q", len(chunk)) + chunk
    return whole[:data_end] + record * copies + whole[data_end:]


@pytest.mark.parametrize(("honest", "sized"), [(True, True), (False, True), (False, False)])
def test_a_chunk_that_unpacks_to_gigabytes_is_damage_and_takes_no_memory(
    whole, tmp_path, honest, sized
):
    content = Whole(bomb(whole, 2**29, 1, honest=honest, sized=sized))
    assert len(content) < 2 * len(whole)
    Path("/proc/self/clear_refs").write_text("5")  # from here on the peak is this test's own
    before = most_memory()
    recording = reread(tmp_path, content)
    assert most_memory() - before < 100_000, "kilobytes"
    assert recording.damage is not None
    assert (len(recording.states), len(recording.steps)) == (COUNT, COUNT)


def most_memory() -> int:
    """The most that this process has held at once [kB]."""
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])


@pytest.mark.parametrize("honest", [True, False])
def test_many_chunks_that_unpack_to_gigabytes_together_are_damage(whole, tmp_path, honest):
    found = reread(tmp_path, Whole(bomb(whole, 2**22, 300, honest=honest)))
    assert "more than a recording holds" in found.damage
    small = write(tmp_path / RECORDING, GOOD).read_bytes()
    found = reread(tmp_path, Whole(bomb(small, 2**22, 3, honest=honest)))
    assert "more than a recording holds" not in found.damage, "16 MiB are always allowed"


GOOD = Step(
    agent="1", k=0, t=0.1, t_apply=0.1, u=(0.0, 0.0), origin=Origin.QP, residual=None,
    solve_time=0.0, ages=[("2", 0.0)], fates=[],
)  # fmt: skip
SHOWN = StepData("1", 3, 0.1, ["1", "4"], [0.0] * 6, [("4", 0.1, [1.0, 0.0])])
MISFITS = {
    "a state too short": State(0.1, [0.0] * 14, 0.0),
    "a step of nobody": msgspec.structs.replace(GOOD, agent="9"),
    "an input too many": msgspec.structs.replace(GOOD, u=(0.0,) * 3),
    "a nominal input too few": msgspec.structs.replace(GOOD, u_nom=(0.0,)),
    "an age of nobody": msgspec.structs.replace(GOOD, ages=[("9", 0.0)]),
    "a broadcast of nobody": msgspec.structs.replace(GOOD, fates=[("9", 0, 0.0)]),
    "a false claim of another size": msgspec.structs.replace(GOOD, false=[("2", 0, 0.0, [0.0])]),
    "a false state of another size": msgspec.structs.replace(GOOD, false_states=[("2", 0, [0.0])]),
    "a command to nobody": Command(0.1, CommandKind.KILL, "9"),
    **{
        f"shown: {change}": msgspec.structs.replace(SHOWN, **change)
        for change in (
            {"agent": "9"},
            {"agent": "2"},
            {"seen": ["4", "1"]},
            {"seen": ["1", "9"]},
            {"x": [0.0] * 5},
            {"received": [("9", 0.1, [1.0, 0.0])]},
            {"received": [("4", 0.1, [1.0])]},
        )
    },
}


@pytest.mark.parametrize("record", MISFITS.values(), ids=MISFITS)
def test_records_that_are_not_of_their_scenario_are_refused(record: Record, tmp_path: Path):
    write(tmp_path / RECORDING, GOOD, SHOWN, record)
    with pytest.raises(UnreadableRecordingError, match=r"at t = 0.1.*: not of its scenario"):
        read(tmp_path)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        *(({"residual": r}, "a number above 1e+303") for r in (1.7e308, -1e304, 10**308)),
        ({"k": 2**64 - 1}, "Expected `int`"),
        ({"k": -1}, "Expected `int`"),
        ({"k": 1, "fates": [("2", 2**63, 0.0)]}, "Expected `int`"),
        ({"k": 1, "origin": "divine"}, "divine"),
    ],
    ids=repr,
)
def test_a_number_or_a_name_that_no_run_has_is_damage(
    tmp_path: Path, changes: dict[str, Any], words: str
):
    write(tmp_path / RECORDING, GOOD, msgspec.structs.replace(GOOD, **changes))
    recording = read(tmp_path)
    assert recording.steps == [GOOD]
    assert words in (recording.damage or "")
    assert recording.summary is None


@pytest.mark.parametrize("kind", [State, Step])
def test_what_comes_after_a_later_time_is_damage(tmp_path: Path, kind: type):
    first = next(each for each in records() if type(each) is kind)
    of_another = msgspec.structs.replace(GOOD, agent="2", t=0.2)
    before = [msgspec.structs.replace(first, t=t) for t in (0.1, 0.3, 0.3)]
    late = msgspec.structs.replace(first, t=0.2)
    recording = read(write(tmp_path / RECORDING, *before, of_another, late, of_another))
    assert (recording.states or recording.steps)[:3] == before
    assert len(recording.states) + len(recording.steps) == 4
    assert "a record of t = 0.2 s after one of 0.3 s" in (recording.damage or "")
    assert recording.summary is None


def test_the_oldest_input_of_a_step_is_that_of_its_ages_also_where_it_is_not_recorded():
    known = msgspec.structs.replace(GOOD, ages=[("2", 0.1), ("3", 0.3)], oldest_input=None)
    assert known.oldest_input == 0.3
    older = {k: v for k, v in msgspec.to_builtins(known).items() if k != "oldest_input"}
    assert msgspec.convert(older, Step) == known


def test_a_recording_may_hold_the_largest_number_that_messages_may(tmp_path: Path):
    large = msgspec.structs.replace(GOOD, residual=1e303)
    log = Log(0.1, "agent e303 is lost")
    recording = read(write(tmp_path / RECORDING, large, SHOWN, log))
    assert (recording.steps, recording.step_data, recording.damage) == ([large], [SHOWN], None)
    assert not recording.step_data[0].adversary


def test_a_recording_whose_chunks_are_not_compressed_is_read_too(tmp_path: Path):
    with RecordingWriter(tmp_path / RECORDING, scenario(), "run-1") as writer:
        writer._writer._Writer__compression = CompressionType.NONE
        writer.write(GOOD)
        writer.finish(FIGURES)
    assert (read(tmp_path).steps, read(tmp_path).damage) == ([GOOD], None)


@pytest.mark.slow
@given(share=shares)
@settings(max_examples=12, deadline=None)
def test_a_disk_that_is_full_at_the_end_leaves_no_summary(whole, tmp_path_factory, share):
    """The disk is full from the last chunk on: without a whole recording there is no verdict."""
    folder = tmp_path_factory.mktemp("full")
    last, _ = chunks(whole)[-1]
    summary = msgspec.structs.replace(FIGURES, outcome=Outcome.GUARANTEED)
    with RecordingWriter(folder / RECORDING, scenario(), "run-1") as writer:
        for record in records():
            writer.write(record)
        with full_disk(last + int(share * (len(whole) - 1 - last))):
            write_summary(summary, folder / SUMMARY, writer)
    assert summary.outcome is Outcome.BROKEN
    assert summary.reason.startswith("guaranteed, but not written down to its end")
    assert str(folder / RECORDING) in summary.reason
    assert [file.name for file in folder.iterdir()] == [RECORDING]
    assert "cut short" in (read(folder).damage or "")


def test_a_summary_that_cannot_be_written_breaks_the_run_and_is_named(tmp_path):
    summary = msgspec.structs.replace(FIGURES)
    with RecordingWriter(tmp_path / RECORDING, scenario(), "run-1") as writer:
        write_summary(summary, tmp_path / "gone" / SUMMARY, writer)
    assert summary.outcome is Outcome.BROKEN
    assert "gone/summary.json" in summary.reason
    assert read(tmp_path).summary is None
