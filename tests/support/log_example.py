"""Artificial run with every kind of joint, for tests of the log."""

import numpy as np

from asrsim.quantities import QUANTITIES
from asrsim.samples import JointInfo, RunInfo, Samples

ORDINARY = tuple(name for name, quantity in QUANTITIES.items() if not quantity.apart)
SEA_QUANTITIES = tuple(
    name for name in ORDINARY if not name.startswith("motor_2") and not name.endswith("_2") and name != "numerical_error"
)
JOINTS = (
    JointInfo(
        name="shoulder", actuator="qbmove", mode=6, namespace="arm/right", motors=2, quantities=(*ORDINARY, "motor_1_voltage")
    ),
    JointInfo(name="élbow-2", actuator="sea", mode=5, namespace="arm/right", motors=1, quantities=SEA_QUANTITIES),
    JointInfo(name="slide", actuator="rigid", mode=None, prismatic=True, quantities=("link_position", "link_velocity")),
    JointInfo(name="lever", actuator="awas_ii", mode=4, motors=2, quantities=(*ORDINARY, "temperature")),
)
INFO = RunInfo(
    robot="two arms",
    joints=JOINTS,
    step=0.001,
    log_every=2,
    variant="soft",
    urdf="<?xml version='1.0'?>\n<robot name='two arms'><!-- é --></robot>\n",
    urdf_path="robots/two_arms.urdf",
    scenario="robot: two_arms.urdf\nstep: 1e-3\n",
    scenario_path="scenarios/reach.yaml",
    resolved={
        "scenario": {"robot": "arm.urdf", "manager": "m.yaml", "external_torques": {}},
        "step": 0.001,
        "limits": [0.1, float("inf")],
        "names": {"é": None},
        "third": 1 / 3,
    },
    metadata={"engine": "bullet", "seed": "7", "empty": ""},
    attachments={"reach.csv": b"t,q\n0,0\n", "manager/right.yaml": b"", "raw": bytes(range(256))},
)


def example_samples(count, *, start=0, info=INFO, bodies=(), contacts=()):
    """Random samples with NaN, infinities, negative zeros and denormals. Equal arguments give equal samples."""
    rng = np.random.default_rng([count, start])
    joints = info.joints
    values = {}
    for quantity in dict.fromkeys(name for joint in joints for name in joint.quantities):
        table = rng.normal(size=(count, len(joints)))
        odd = np.array([np.nan, np.inf, -np.inf, -0.0, 5e-324, 0.1 + 0.2])
        where = rng.random(table.shape) < 0.05
        table[where] = rng.choice(odd, size=int(where.sum()))
        for index, joint in enumerate(joints):
            if quantity not in joint.quantities:
                table[:, index] = np.nan
        values[quantity] = table
    return Samples(
        time=np.arange(start, start + count) * info.step * info.log_every,
        joints=tuple(joint.name for joint in joints),
        values=values,
        bodies={name: rng.normal(size=(count, 7)) for name in bodies},
        contacts={name: rng.normal(size=(count, 3)) for name in contacts},
    )


def part(samples, rows):
    """Samples in the given rows."""
    return Samples(
        time=samples.time[rows],
        joints=samples.joints,
        values={name: table[rows] for name, table in samples.values.items()},
        bodies={name: table[rows] for name, table in samples.bodies.items()},
        contacts={name: table[rows] for name, table in samples.contacts.items()},
    )


def assert_same(left, right):
    """Assert that both samples are equal bit for bit, including names and shapes."""
    assert left.joints == right.joints
    assert left.time.tobytes() == right.time.tobytes()
    for a, b in ((left.values, right.values), (left.bodies, right.bodies), (left.contacts, right.contacts)):
        assert set(a) == set(b)
        for name in a:
            assert a[name].shape == b[name].shape, name
            assert np.ascontiguousarray(a[name]).tobytes() == np.ascontiguousarray(b[name]).tobytes(), name
