"""JointState messages as programs of ROS write them in text: each number belongs to the joint that the names state."""

import numpy as np
import pytest

from asrsim.recordings import read_recording

TIME = 0.01 * np.arange(40)
POSITIONS = {"shoulder": 0.3 * np.sin(4 * TIME), "elbow": 0.2 * np.cos(3 * TIME), "wrist": 0.1 * np.sin(7 * TIME + 0.4)}
HEADER = "%time,field.header.seq,field.header.stamp,field.header.frame_id"


def read(tmp_path, rows, header=None, **keys):
    path = tmp_path / "lab.csv"
    path.write_text("\n".join([*([] if header is None else [header]), *rows]) + "\n")
    return read_recording(path, **keys)


def stamped(i):
    return 1_700_000_000_900_000_000 + 10_000_000 * i


def check(recording, **names):
    """Positions of the recording's joints; names: joint of the recording for each of POSITIONS."""
    for joint, called in names.items():
        column = recording.column(called, "link_position")
        known = np.isfinite(column.values)
        assert known.sum() >= 10
        np.testing.assert_allclose(column.values[known], POSITIONS[joint][known], atol=1e-9)
        np.testing.assert_allclose(column.time, TIME, atol=1e-6)


def rostopic(order, called=str):
    """Rows of `rostopic echo -p` with the joints in the order of `order(i)`."""
    for i in range(len(TIME)):
        cells = [stamped(i), i, stamped(i), "", *(called(name) for name in order(i))]
        yield ",".join(map(str, [*cells, *(f"{POSITIONS[name][i]:.9f}" for name in order(i))]))


@pytest.mark.parametrize("form", ["field.{}{}", "/joint_states/{}[{}]", "arm.{}({})"])
def test_a_column_of_names_says_whose_the_columns_with_its_number_are(tmp_path, form):
    names = ",".join(form.format(word, i) for word in ("name", "position") for i in range(2))
    rows = [*rostopic(lambda _: ("elbow", "shoulder"))]
    # The joints of a robot change nothing where the file states the names.
    for joints in (None, ("shoulder", "elbow")):
        recording = read(tmp_path, rows, f"{HEADER},{names}", joints=joints)
        check(recording, shoulder="shoulder", elbow="elbow")
    assert not [one for one in recording.findings if one.code == "text-column" and "name" in one.key]


@pytest.mark.parametrize("written", ["'{}'", '"{}"', "arm/{}", "{}[0]", "b'{}'"])
def test_names_may_have_quotes_brackets_and_namespaces(tmp_path, written):
    names = "field.name0,field.name1,field.position0,field.position1"
    recording = read(tmp_path, rostopic(lambda _: ("elbow", "shoulder"), written.format), f"{HEADER},{names}")
    plain = written.removeprefix("b").strip("'\"")
    check(recording, shoulder=plain.format("shoulder"), elbow=plain.format("elbow"))


def test_values_follow_names_that_change_their_order(tmp_path):
    names = "field.name0,field.name1,field.position0,field.position1"
    orders = ("elbow", "shoulder"), ("shoulder", "elbow"), ("wrist", "elbow")
    recording = read(tmp_path, rostopic(lambda i: orders[i % 3]), f"{HEADER},{names}")
    check(recording, shoulder="shoulder", elbow="elbow", wrist="wrist")
    assert "names-change" in {one.code for one in recording.findings}
    assert "repeated-name" not in {one.code for one in recording.findings}


def test_a_joint_that_one_row_names_twice_is_told(tmp_path):
    names = "field.name0,field.name1,field.position0,field.position1"
    recording = read(tmp_path, rostopic(lambda i: ("elbow", "elbow" if i == 5 else "shoulder")), f"{HEADER},{names}")
    assert any("named several times in 1 row;" in doubt for doubt in recording.doubts)


def test_names_without_a_number_of_their_own_are_no_joints(tmp_path):
    """Nine names and one position: most cells of a row are text."""
    names = ",".join([*(f"field.name{i}" for i in range(9)), "field.position0"])
    others = ",".join(f"finger_{i}" for i in range(8))
    rows = [f"{stamped(i)},{i},{stamped(i)},,elbow,{others},{POSITIONS['elbow'][i]:.9f}" for i in range(len(TIME))]
    recording = read(tmp_path, rows, f"{HEADER},{names}")
    assert recording.joints == ("elbow",)
    check(recording, elbow="elbow")


@pytest.mark.parametrize(
    ("names", "values"),
    [
        ("['{}', '{}']", "({:.9f}, {:.9f})"),
        ('[""{}"", ""{}""]', "[{:.9f} {:.9f}]"),
        ("[{}, {}]", "array('d', [{:.9f}, {:.9f}])"),
    ],
)
def test_lists_in_cells_are_read_entry_by_entry(tmp_path, names, values):
    rows = [
        f'{t + 1.7e9:.9f},{i},"{names.format("elbow", "shoulder")}",'
        f'"{values.format(POSITIONS["elbow"][i], POSITIONS["shoulder"][i])}","()"'
        for i, t in enumerate(TIME)
    ]
    check(read(tmp_path, rows, "Time,header.seq,name,position,effort"), shoulder="shoulder", elbow="elbow")


def test_lists_of_two_publishers_are_told_apart_by_their_names(tmp_path):
    lists = [("\"['elbow', 'shoulder']\"", ("elbow", "shoulder")), ("\"['wrist']\"", ("wrist",))]
    rows = []
    for i, t in enumerate(TIME):
        cell, joints = lists[i % 2]
        rows.append(f'{t:.9f},{cell},"[{", ".join(f"{POSITIONS[name][i]:.9f}" for name in joints)}]"')
    check(read(tmp_path, rows, "time,name,position"), shoulder="shoulder", elbow="elbow", wrist="wrist")


@pytest.mark.parametrize("arrays", [1, 2, 3])
@pytest.mark.parametrize("frame", ["", "base"])
def test_rows_of_ros_2_without_a_header(tmp_path, arrays, frame):
    """`ros2 topic echo --csv`: s, ns, frame, names, positions, velocities, efforts."""
    rates = {name: np.gradient(values, TIME) for name, values in POSITIONS.items()}
    rows = []
    for i in range(len(TIME)):
        numbers = [source[name][i] for source in (POSITIONS, rates, POSITIONS)[:arrays] for name in POSITIONS]
        whole, part = divmod(stamped(i), 10**9)
        rows.append(",".join(map(str, [whole, part, frame, *POSITIONS, *(f"{number:.12f}" for number in numbers)])))
    recording = read(tmp_path, rows)
    check(recording, **{name: name for name in POSITIONS})
    if arrays > 1:
        np.testing.assert_allclose(recording.column("wrist", "link_velocity").values, rates["wrist"], atol=1e-9)
    (said,) = [one for one in recording.findings if one.code == "no-header"]
    assert "JointState" in said.message


def test_text_that_is_no_list_and_lists_that_are_too_long_are_no_numbers(tmp_path):
    """An image in a cell is a picture, not a joint's array; a cell that nests brackets deeply does no harm."""
    picture, nested = '"[' + ",".join(["0"] * 500) + ']"', '"' + "[" * 5000 + '"'
    rows = [f"{t:.9f},{POSITIONS['elbow'][i]:.9f},{picture},{nested}" for i, t in enumerate(TIME)]
    assert {*read(tmp_path, rows, "time,elbow.position,pixels,odd").channels} == {"elbow.position"}


def test_the_parts_of_a_controllers_state_keep_their_meaning(tmp_path):
    """The desired positions of a JointTrajectoryControllerState come first; they are commands, not measured positions."""
    fields = ",".join(
        f"field.{what}0" for what in ("joint_names", "desired.positions", "desired.velocities", "actual.positions")
    )
    rows = [f"{stamped(i)},elbow,{0.5 + t:.9f},1,{POSITIONS['elbow'][i]:.9f}" for i, t in enumerate(TIME)]
    recording = read(tmp_path, rows, f"%time,{fields}")
    check(recording, elbow="elbow")
    np.testing.assert_allclose(recording.column("elbow", "reference_1").values, 0.5 + TIME, atol=1e-9)
    assert {column.quantity for column in recording.channels.values()} == {"link_position", "reference_1", None}
