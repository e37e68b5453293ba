"""Logs for tests of plots: short runs of example scenarios, and artificial runs with known values."""

from dataclasses import replace

import numpy as np

from asrsim.log import LogWriter
from asrsim.samples import JointInfo, RunInfo, Samples
from asrsim.scenario import load_scenario
from asrsim.simulation.run import simulate
from support.paths import EXAMPLES


def simulated_log(scenario, path, *, variant=None, duration=0.2):
    """Write the log of a short run of an example scenario."""
    found = load_scenario(EXAMPLES / "scenarios" / f"{scenario}.yaml", variant=variant, overrides=[f"duration={duration}"])
    path.parent.mkdir(parents=True, exist_ok=True)
    writers = []

    def sinks(info):
        writers.append(LogWriter(path, info))
        return writers

    scenario = found[0]
    if scenario.task is not None:
        poses = tuple(pose for pose in scenario.task.poses if pose.time <= duration)
        scenario = replace(scenario, task=replace(scenario.task, poses=poses))
    simulate(scenario, sinks=sinks, keep=False)
    writers[0].close()
    return path


def made_up_log(
    path,
    *,
    joints=1,
    count=1001,
    step=0.001,
    variant="soft",
    expect=(),
    values=None,
):
    """Write the log of a qbMove in mode 6 that follows a sine of 1 Hz and 0.5 rad with a gain of 0.8 and a delay of 50 ms."""
    time = np.arange(count) * step
    reference = 0.5 * np.sin(2 * np.pi * time)
    columns = {
        "link_position": 0.4 * np.sin(2 * np.pi * (time - 0.05)),
        "link_velocity": 0.4 * 2 * np.pi * np.cos(2 * np.pi * (time - 0.05)),
        "link_torque": np.full(count, 0.25),
        "stiffness": np.full(count, 10.0),
        "motor_1_position": reference + 0.2,
        "motor_2_position": reference - 0.2,
        "reference_1": reference,
        "reference_2": np.full(count, 0.2),
        "external_torque": np.zeros(count),
        **(values or {}),
    }
    infos = tuple(
        JointInfo(name=f"joint_{number}", actuator="qbmove", mode=6, motors=2, quantities=tuple(columns))
        for number in range(1, joints + 1)
    )
    info = RunInfo(
        robot="made_up",
        joints=infos,
        step=step,
        variant=variant,
        urdf="<robot name='made_up'/>",
        resolved={"scenario": {"robot": "robot.urdf", "duration": 1.0, "expect": list(expect)}},
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    with LogWriter(path, info) as log:
        for start in range(0, count, 5000):
            rows = slice(start, start + 5000)
            log.write(
                Samples(
                    time=time[rows],
                    joints=tuple(joint.name for joint in infos),
                    values={name: np.repeat(column[rows, None], joints, axis=1) for name, column in columns.items()},
                )
            )
    return path
