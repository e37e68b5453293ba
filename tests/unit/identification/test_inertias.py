"""Inertias of links: they stay physically possible, and recordings with known payloads tell them from the scale of the torque.

The recordings are solutions of the equations of motion, which SciPy integrates.
"""

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_ivp

from asrsim.errors import InputError
from asrsim.identification import identify

ROBOT = """<robot name="gimbal">
  <link name="base"/>
  <joint name="yaw" type="continuous"><parent link="base"/><child link="fork"/><axis xyz="0 0 1"/>
    <dynamics damping="0.05"/></joint>
  <link name="fork"><inertial><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="roll" type="continuous"><parent link="fork"/><child link="plate"/><axis xyz="1 0 0"/>
    <dynamics damping="0.05"/></joint>
  <link name="plate"><inertial><mass value="1"/>
    <inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial></link>
</robot>
"""
FORK, DAMPING = 0.01, 0.05
PLATE = (0.012, 0.028, 0.04)
"""Moments of inertia of a flat plate: the largest is the sum of the other two, kg m^2."""
GAINS = ["yaw.reference_1.gain", "roll.reference_1.gain"]
FREE = ["plate.ixx", "plate.iyy", "plate.izz"]


def torques(time):
    return 0.25 * np.sin(5.0 * time) + 0.1 * np.sin(13.0 * time), 0.2 * np.sin(4.0 * time + 1.0)


def gimbal(path, *, payload=0.0, gain=1.0, noise=2e-3, seed=0):
    """Recording of a fork that turns about z and carries a plate that turns about x, both about their common centre.

    payload: moment of inertia of a mass on the plate's y axis, kg m^2; gain: recorded torques are the torques divided by it.
    """
    xx, yy, zz = PLATE[0] + payload, PLATE[1], PLATE[2] + payload

    def slope(time, state):
        _, roll, spin, speed = state
        first, second = torques(time)
        about, change = FORK + zz * np.cos(roll) ** 2 + yy * np.sin(roll) ** 2, (yy - zz) * np.sin(2.0 * roll)
        return [
            spin,
            speed,
            (first - DAMPING * spin - change * spin * speed) / about,
            (second - DAMPING * speed + 0.5 * change * spin**2) / xx,
        ]

    time = np.arange(0.0, 3.0, 0.02)
    found = solve_ivp(slope, (0.0, time[-1]), np.zeros(4), method="DOP853", t_eval=time, rtol=1e-9, atol=1e-10)
    places = found.y[:2] + noise * np.random.default_rng(seed).normal(size=(2, len(time)))
    head = "time [s]," + ",".join(
        f"{joint}.{name}" for name in ("reference_1 [N m]", "link_position [rad]") for joint in ("yaw", "roll")
    )
    table = np.column_stack([time, *(one / gain for one in torques(time)), *places])
    np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.9g")
    return path


def lab(folder):
    (folder / "gimbal.urdf").write_text(ROBOT)
    keys = "duration: 3\nstep: 0.005\ngravity: [0, 0, 0]\nactuators: {'*': {type: sea, mode: 0}}\n"
    (folder / "lab.yaml").write_text(f"robot: gimbal.urdf\n{keys}")
    return folder / "lab.yaml"


def test_an_estimated_inertia_is_physically_possible(tmp_path):
    """Noise alone would make the largest moment of the plate exceed the sum of the other two."""
    result = identify(lab(tmp_path), [gimbal(tmp_path / "a.csv", seed=2)], free=FREE)
    found = [result.find(key).value for key in FREE]
    assert found == pytest.approx(PLATE, rel=2e-3)
    assert found[2] <= found[0] + found[1]
    assert result.fits
    assert [text for text in result.remarks if text.startswith("the inertia of plate is at the limit")]


PAYLOAD = {"link": "plate", "mass": 0.5, "centre": [0, 0.2, 0]}
"""A point mass with a moment of inertia of 0.02 kg m^2 about the plate's x and z axes."""


def loaded(folder, **payload):
    """Fit file with a bare recording and a recording with a payload. The scale of the torque sensors is wrong by 25 %."""
    lab(folder)
    names = [gimbal(folder / "a.csv", gain=1.25).name, gimbal(folder / "b.csv", gain=1.25, payload=0.02, seed=1).name]
    fit = {
        "scenario": "lab.yaml",
        "experiments": [names[0], {"file": names[1], "payload": PAYLOAD | payload}],
        "free": {key: {} for key in (*FREE, "yaw.damping", "roll.damping", GAINS[0])},
        "ties": {GAINS[1]: GAINS[0]},
    }
    (folder / "lab.fit.yaml").write_text(yaml.safe_dump(fit))
    return folder / "lab.fit.yaml"


def test_a_known_payload_tells_inertias_from_the_scale_of_the_torque(tmp_path):
    """Torques with an unknown scale determine only ratios of inertias, unless one inertia is known."""
    result = identify(loaded(tmp_path))
    assert result.fits
    assert result.find("yaw.reference_1.gain").value == pytest.approx(1.25, rel=0.005)
    assert [result.find(key).value for key in FREE] == pytest.approx(PLATE, rel=0.01)
    assert result.find("plate.ixx").verdict == "identified"
    alone = identify(
        tmp_path / "lab.yaml", [tmp_path / "a.csv"], free=[*FREE, "yaw.damping", "roll.damping", *GAINS[:1]],
        ties=["=".join(reversed(GAINS))],
    )  # fmt: skip
    assert alone.find("plate.ixx").verdict == "only as ratio"


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        ({"link": "plaet"}, "Did you mean 'plate'"),
        ({"mass": 0.0}, "payload.mass"),
        ({"inertia": [1, 0, 0, 1, 0, 3]}, "its inertia is physically impossible"),
    ],
)
def test_a_wrong_payload_is_one_clear_error(tmp_path, payload, message):
    with pytest.raises(InputError, match=message):
        identify(loaded(tmp_path, **payload))


def test_the_first_recording_has_no_payload(tmp_path):
    """The fit writes a scenario that repeats the first recording."""
    fit = loaded(tmp_path)
    fit.write_text(fit.read_text().replace("- a.csv\n", "").replace("free:", "- a.csv\nfree:"))
    with pytest.raises(InputError, match="List a recording without payload first"):
        identify(fit)
