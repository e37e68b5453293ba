"""Samples and RunInfo go into a log and come out of it bit for bit, whole or in parts."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from asrsim.errors import LogError, OutputError
from asrsim.log import LogWriter, open_log, read_log
from asrsim.samples import JointInfo, RunInfo, Samples, concatenate
from support.log_example import INFO, assert_same, example_samples, part


@pytest.fixture(scope="module")
def log_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    with LogWriter(path, INFO) as writer:
        writer.write(example_samples(3000, bodies=("box", "ball"), contacts=("box/ground", "box/finger-1")))
        writer.close({"summary": "fine", "error_estimate": "1e-6"})
    return path


@pytest.fixture(scope="module")
def samples():
    return example_samples(3000, bodies=("box", "ball"), contacts=("box/ground", "box/finger-1"))


def test_result_and_run_metadata(log_path):
    reader = open_log(log_path)
    result = {"status": "complete", "samples": "3000", "summary": "fine", "error_estimate": "1e-6"}
    assert result.items() <= reader.metadata.items()
    assert reader.metadata["engine"] == "bullet"
    assert reader.metadata["log_every"] == "2"
    assert reader.duration == pytest.approx(2999 * 0.002)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    sizes=st.lists(st.integers(0, 600), max_size=5),
    numbers=st.lists(st.floats(width=64), min_size=1, max_size=8),
    step=st.floats(1e-7, 0.5),
)
def test_any_numbers_in_any_chunks(tmp_path, sizes, numbers, step):
    info = RunInfo(robot="r", joints=(JointInfo(name="j", actuator="sea", mode=0, quantities=("link_position",)),), step=step)
    count = sum(sizes)
    whole = Samples(
        time=np.arange(count) * step,
        joints=("j",),
        values={"link_position": np.resize(np.array(numbers), (count, 1))},
    )
    path = tmp_path / "run.mcap"
    with LogWriter(path, info) as writer:
        start = 0
        for size in sizes:
            writer.write(part(whole, slice(start, start + size)))
            start += size
    assert_same(read_log(path).samples, whole)


def test_selection_by_quantity_and_joint(log_path, samples):
    log = read_log(log_path, quantities=["motor_1_torque", "link_position"], joints=["lever", "shoulder"])
    assert log.samples.joints == ("lever", "shoulder")
    assert list(log.samples.values) == ["motor_1_torque", "link_position"]
    np.testing.assert_array_equal(log.samples.values["motor_1_torque"], samples.values["motor_1_torque"][:, [3, 0]])


def test_the_index_of_attachments_leads_to_their_records(tmp_path):
    """Other programs read an attachment at its place: a byte 9, the length, and the record."""
    files = {"arm/robot.urdf": b"<robot/>", "lab.csv": b"t,q\n" * 500}
    with LogWriter(tmp_path / "log.mcap", replace(INFO, attachments=files)) as log:
        log.write(example_samples(20))
    data = (tmp_path / "log.mcap").read_bytes()
    with (tmp_path / "log.mcap").open("rb") as stream:
        places = {one.name: one for one in make_reader(stream).get_summary().attachment_indexes}
    for name, content in files.items():
        place = next(one for key, one in places.items() if key.endswith(name))
        record = data[place.offset : place.offset + place.length]
        assert (record[0], int.from_bytes(record[1:9], "little")) == (9, place.length - 9)
        assert content in record
        assert place.data_size == len(content)


@pytest.mark.parametrize("stride", [None, 1, 7, 1000, 5000])
@pytest.mark.parametrize(("start", "end"), [(None, None), (0.5, 4.0), (0.0, 0.0), (5.9, 99.0)])
def test_selection_by_time_and_stride(log_path, samples, start, end, stride):
    low, high = (-1.0 if start is None else start), (100.0 if end is None else end)
    chosen = np.flatnonzero((samples.time >= low) & (samples.time <= high))[::stride]
    log = read_log(log_path, start=start, end=end, stride=stride)
    np.testing.assert_array_equal(log.samples.time, samples.time[chosen])
    np.testing.assert_array_equal(log.samples.bodies["ball"], samples.bodies["ball"][chosen])


@pytest.mark.parametrize(
    ("window", "said"),
    [
        ({"start": 3.0, "end": 1.0}, r"end: must not be before the start, 3 s \(got 1\.0\)"),
        ({"start": 50.0}, r"no samples in that time.*It lasts from 0 to 5\.998 s"),
        ({"start": -2.0, "end": -1.0}, r"no samples in that time.*It lasts from 0 to 5\.998 s"),
    ],
)
def test_a_window_without_samples_is_refused(log_path, window, said):
    with pytest.raises(LogError, match=re.compile(said, re.DOTALL)):
        read_log(log_path, **window)


def test_unknown_names_are_all_listed(log_path):
    with pytest.raises(LogError) as caught:
        read_log(log_path, quantities=["link_positon"], joints=["shoulder", "hip"])
    assert [problem.code for problem in caught.value.problems] == ["unknown-quantity", "unknown-joint"]
    assert "link_position" in str(caught.value.problems[0].hint)
    with pytest.raises(LogError, match="stride"):
        read_log(log_path, stride=0)
    assert caught.value.problems[1].choices == ("shoulder", "élbow-2", "slide", "lever")


def test_bodies_and_contacts_may_come_and_go(tmp_path):
    path = tmp_path / "run.mcap"
    first = example_samples(50, bodies=("box",))
    second = example_samples(50, start=50, bodies=("box", "ball"), contacts=("box/ground",))
    third = example_samples(50, start=100)
    with LogWriter(path, INFO) as writer:
        for chunk in (first, second, third):
            writer.write(chunk)
    log = read_log(path).samples
    assert_same(log, concatenate([first, second, third]))
    assert np.isnan(log.bodies["ball"]).all(axis=1).tolist() == [True] * 50 + [False] * 50 + [True] * 50


def test_joint_names_that_look_alike_to_ros_stay_apart(tmp_path):
    names = ("a-b", "a_b", "a.b", "1st")
    joints = tuple(JointInfo(name=name, actuator="sea", mode=0, quantities=("link_position",)) for name in names)
    info = RunInfo(robot="r", joints=joints, step=0.1)
    samples = example_samples(5, info=info)
    path = tmp_path / "run.mcap"
    with LogWriter(path, info) as writer:
        writer.write(samples)
    assert_same(read_log(path).samples, samples)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    topics = [channel.topic for channel in summary.channels.values()]
    assert len(topics) == len(set(topics)) > len(names)
    assert all(re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", topic) for topic in topics), topics


@pytest.mark.parametrize(("error", "status"), [(KeyboardInterrupt(), "interrupted"), (ValueError("no"), "failed")])
def test_an_exception_leaves_a_closed_log(tmp_path, error, status):
    path = tmp_path / "run.mcap"
    samples = example_samples(10)

    def run():
        with LogWriter(path, INFO) as writer:
            writer.write(samples)
            raise error

    with pytest.raises(type(error)):
        run()
    log = read_log(path)
    assert (log.status, log.truncated) == (status, False)
    assert_same(log.samples, samples)


def test_a_closed_log_takes_nothing_more(tmp_path):
    writer = LogWriter(tmp_path / "run.mcap", INFO)
    writer.close({"status": "diverged"})
    with pytest.raises(OutputError, match="closed"):
        writer.write(example_samples(1))
    assert read_log(writer.path).status == "diverged"


def test_same_run_same_bytes(tmp_path):
    for name in ("a", "b"):
        with LogWriter(tmp_path / name, INFO) as writer:
            writer.write(example_samples(300))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
