"""Killed writers, cut files, full disks, foreign and damaged files: nothing that was written is lost, nothing crashes."""

import os
import re
import resource
from itertools import cycle

import numpy as np
import pytest
from mcap.reader import make_reader

from asrsim.errors import LogError, OutputError
from asrsim.log import LogWriter, open_log, read_log
from support.log_example import INFO, assert_same, example_samples, part

COUNT = 6000


@pytest.fixture(scope="module")
def samples():
    return example_samples(COUNT)


@pytest.fixture(scope="module")
def whole(tmp_path_factory, samples):
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    with LogWriter(path, INFO) as writer:
        writer.write(samples)
    return path.read_bytes()


def official_times(path):
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [np.frombuffer(message.data, "<f8", 1, 4)[0] for _, _, message in reader.iter_messages("/asrsim/time")]


def test_a_log_is_readable_while_it_is_written(tmp_path, samples):
    from rosbags.highlevel import AnyReader

    path = tmp_path / "run.mcap"
    writer = LogWriter(path, INFO)
    assert len(read_log(path).samples.time) == 0
    seen = set()
    with AnyReader([path]) as reader:
        assert reader.message_count == 0
    for start in range(0, COUNT, 500):
        writer.write(part(samples, slice(start, start + 500)))
        log = read_log(path)
        assert log.truncated
        assert_same(log.samples, part(samples, slice(0, len(log.samples.time))))
        seen.add(len(log.samples.time))
    assert len(seen) > 4
    with AnyReader([path]) as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
    assert counts["/joint_states"] == counts["/lever/details"] == max(seen)
    writer.close()
    assert_same(read_log(path).samples, samples)


def test_every_write_leaves_a_file_for_the_official_reader(tmp_path, samples, monkeypatch):
    """A process may be killed between any two writes to the file: there, too, the file is whole."""
    path = tmp_path / "run.mcap"
    counts = []
    write = os.write

    def watched(file, data):
        written = write(file, data)
        times = official_times(path)
        assert times == samples.time[: len(times)].tolist()
        assert len(read_log(path).samples.time) == len(times)
        counts.append(len(times))
        return written

    monkeypatch.setattr(os, "write", watched)
    with LogWriter(path, INFO) as writer:
        writer.write(part(samples, slice(0, 1400)))
    assert counts == sorted(counts)
    # A process that is killed loses at most a chunk.
    assert len(chunks := sorted(set(counts))) == 3
    assert chunks[::2] == [0, 1400]


def test_cut_anywhere_it_is_read_or_refused(tmp_path, whole, samples):
    path = tmp_path / "cut.mcap"
    rng = np.random.default_rng(0)
    described = whole.index(b"asrsim_version")
    cuts = [*rng.integers(0, len(whole), 20), *range(len(whole) - 200, len(whole), 7), 1, 8, 9, described]
    counts = []
    for cut in cuts:
        path.write_bytes(whole[:cut])
        try:
            log = read_log(path)
        except LogError:
            assert cut < described
            continue
        assert log.truncated
        assert_same(log.samples, part(samples, slice(0, len(log.samples.time))))
        counts.append(len(log.samples.time))
    assert COUNT in counts
    assert 0 in counts
    assert len(set(counts)) > 4


def test_flipped_bytes_never_pass_unseen_nor_crash(tmp_path, whole, samples):
    path = tmp_path / "bad.mcap"
    rng = np.random.default_rng(1)
    refused = 0
    for place in rng.integers(0, len(whole), 40):
        data = bytearray(whole)
        data[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        try:
            log = read_log(path)
        except LogError:
            refused += 1
        else:
            assert_same(log.samples, part(samples, slice(0, len(log.samples.time))))
    assert refused > 20


def test_a_closed_log_opens_without_its_chunks(tmp_path, whole):
    path = tmp_path / "run.mcap"
    path.write_bytes(whole)
    closed = open_log(path)
    with path.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    data = bytearray(whole)
    for chunk in chunks:
        size = chunk.chunk_length + chunk.message_index_length
        data[chunk.chunk_start_offset : chunk.chunk_start_offset + size] = bytes(size)
    path.write_bytes(data)
    assert open_log(path).duration == closed.duration == pytest.approx((COUNT - 1) * INFO.step * INFO.log_every)
    with pytest.raises(LogError):
        read_log(path)


def test_a_damaged_chunk_is_named_by_its_time(tmp_path, whole):
    path = tmp_path / "bad.mcap"
    path.write_bytes(whole)
    with path.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    chunk = sorted(chunks, key=lambda one: one.message_start_time)[1]
    data = bytearray(whole)
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(LogError, match=re.escape(f"(at {chunk.message_start_time * 1e-9:g} s)")):
        read_log(path)


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"", "empty-log"),
        (b"time,q\n0,0\n", "not-mcap"),
        (b"\x89MCAP0\r\n", "foreign-log"),
        (b"\x89MCAP0\r\n" + b"\xff" * 5000, "foreign-log"),
    ],
)
def test_files_that_are_no_logs(tmp_path, content, code):
    path = tmp_path / "file.mcap"
    path.write_bytes(content)
    with pytest.raises(LogError) as caught:
        open_log(path)
    assert caught.value.problems[0].code == code
    assert caught.value.problems[0].file == path


def test_places_that_cannot_be_read_or_written_are_named(tmp_path):
    with pytest.raises(LogError, match="cannot read"):
        read_log(tmp_path / "none.mcap")
    for path in (tmp_path, tmp_path / "none" / "run.mcap"):
        with pytest.raises(OutputError, match=r"cannot (write|be written)"):
            LogWriter(path, INFO)


@pytest.mark.parametrize("spare", [0, 30, 5000, 200_000])
def test_a_full_disk_keeps_what_is_written(tmp_path, samples, spare):
    path = tmp_path / "run.mcap"
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    writer = LogWriter(path, INFO)
    writer.write(part(samples, slice(0, 3000)))
    kept = len(read_log(path).samples.time)
    size = path.stat().st_size
    assert kept > 1000
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + spare, old[1]))
        with pytest.raises(OutputError, match="File too large"):
            writer.write(part(samples, slice(3000, COUNT)))
        with pytest.raises(OutputError, match="closed"):
            writer.write(part(samples, slice(0, 1)))
        assert path.stat().st_size == size
        if spare < 10_000:
            with pytest.raises(OutputError, match="File too large"):
                writer.close({"status": "failed"})
        else:
            writer.close({"status": "failed"})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    log = read_log(path)
    assert_same(log.samples, part(samples, slice(0, kept)))
    assert official_times(path) == samples.time[:kept].tolist()
    assert log.status == ("truncated" if spare < 10_000 else "failed")


def test_partial_writes_continue_with_the_remaining_bytes(tmp_path, monkeypatch, samples, whole):
    write, sizes = os.write, cycle((1, 700, 13))
    monkeypatch.setattr(os, "write", lambda file, data: write(file, data[: next(sizes)]))
    with LogWriter(tmp_path / "run.mcap", INFO) as writer:
        writer.write(samples)
    assert (tmp_path / "run.mcap").read_bytes() == whole


@pytest.mark.slow
def test_memory_does_not_grow_with_duration(tmp_path):
    import tracemalloc
    from dataclasses import replace

    chunk = example_samples(1000)
    span = 1000 * INFO.step * INFO.log_every

    def peaks(count):
        """Peak memory in bytes of writing and of reading `count` thousand samples."""
        path = tmp_path / "run.mcap"
        tracemalloc.start()
        with LogWriter(path, INFO) as writer:
            for index in range(count):
                writer.write(replace(chunk, time=chunk.time + index * span))
        written = tracemalloc.get_traced_memory()[1]
        tracemalloc.reset_peak()
        total = sum(len(part.time) for part in open_log(path).iter_samples())
        read = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert total == count * 1000
        return written, read

    short, long = peaks(10), peaks(400)
    assert long[0] < short[0] + 2_000_000
    assert long[1] < short[1] + 2_000_000
