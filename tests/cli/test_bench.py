"""`asrsim bench`: table and picture."""

from __future__ import annotations

import csv

import pytest

from validation.released import URDF


def test_bench_draws_its_picture_next_to_the_table(tmp_path, asrsim_command):
    """The motion turns a link away from its motor, which stands at zero; the spring has 10 N m/rad."""
    (tmp_path / "robot.urdf").write_text(URDF.format(plugin="libsea_plugin.so", mode=5, tags="<spring_k>10</spring_k>"))
    (tmp_path / "motion.csv").write_text("time,joint.position\n0,0\n0.001,0.001\n0.002,0.002\n")
    files = ("bench", tmp_path / "robot.urdf", tmp_path / "motion.csv", "-o", tmp_path / "out.csv")
    assert asrsim_command(*files, "--no-plot").code == 0
    assert not (tmp_path / "out.png").exists()
    assert asrsim_command(*files).code == 0
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "out.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["joint.link_position"]) for row in rows] == [0.0, 0.001, 0.002]
    for row in rows:
        deflection = float(row["joint.motor_1_position"]) - float(row["joint.link_position"])
        assert float(row["joint.elastic_torque_1"]) == pytest.approx(10.0 * deflection, abs=1e-12)


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("time,joint.positon", "joint.positon: is not a column of the bench"),
        ("time,joint.reference_1", "joint.position: column of numbers is missing"),
    ],
)
def test_a_wrong_column_of_the_motion_is_named(tmp_path, asrsim_command, header, said):
    (tmp_path / "robot.urdf").write_text(URDF.format(plugin="libsea_plugin.so", mode=5, tags=""))
    (tmp_path / "motion.csv").write_text(f"{header}\n0,0\n0.001,0.1\n")
    outcome = asrsim_command("bench", tmp_path / "robot.urdf", tmp_path / "motion.csv", "-o", tmp_path / "out.csv")
    assert outcome.code == 1
    assert f"motion.csv:1: {said}" in outcome.err
