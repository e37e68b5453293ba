"""Robots and recordings with known true parameters, for tests of identification."""

from types import SimpleNamespace

import numpy as np

from asrsim.identification.data import Channel
from asrsim.identification.parameters import FitParameter, make_layout
from asrsim.identification.problem import FitProblem, Meter, set_up
from asrsim.identification.task import task_of
from asrsim.identification.track import Playing
from asrsim.scenario import load_scenario
from asrsim.simulation.run import simulate

ROBOT = """<?xml version="1.0"?>
<!-- a lab's robot -->
<robot name="lab">
  <link name="world"/>
  <joint name="joint_1" type="revolute">
    <parent link="world"/> <child link="link_1"/> <axis xyz="0 0 1"/>
    <limit effort="1000" velocity="10000" lower="-10" upper="10"/>
    <dynamics damping="{damping}" friction="{friction}"/>   <!-- guessed -->
  </joint>
  <link name="link_1">
    <inertial><mass value="0.5"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="{izz}"/></inertial>
  </link>
  <gazebo>
    <plugin name="c1" filename="lib{actuator}_plugin.so">
      <joint>joint_1</joint> <operation_mode>{mode}</operation_mode>
      <pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>
      {tags}
    </plugin>
  </gazebo>
</robot>
"""
SEA = {"actuator": "sea", "mode": 3, "damping": 0.02, "friction": 0.0, "izz": 0.009, "tags": "<spring_k>4.0</spring_k>"}
CHIRP = "{chirp: {amplitude: 0.3, from: 0.5, to: 6, duration: 2}}"


def write(folder, name, numbers, references=None, duration=2.0):
    """Write a robot and its scenario, and return the path of the scenario."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.urdf").write_text(ROBOT.format(**numbers))
    text = f"robot: {name}.urdf\nduration: {duration}\nengine: mujoco\n"
    if references is not None:
        text += f"references:\n  joint_1: {references}\n"
    (folder / f"{name}.yaml").write_text(text)
    return folder / f"{name}.yaml"


def record(scenario, path, quantities=("link_position",), *, noise=1e-3, seed=0, every=2, offset=0.0, late=0):
    """Write a run of a scenario as a noisy recording. late: delay of the measured columns relative to the commands, samples."""
    samples = simulate(load_scenario(scenario)[0]).samples
    assert samples is not None
    joint, generator = samples.joint("joint_1"), np.random.default_rng(seed)
    columns = {"time [s]": samples.time}
    columns |= {f"joint_1.{name}": joint[name] for name in ("reference_1", "reference_2") if name in joint}
    for name in quantities:
        values = joint[name] + (offset if name == "link_position" else 0.0)
        if late:
            values = np.concatenate([np.full(late, values[0]), values[:-late]])
        unit = "N m" if name.startswith("elastic") else "rad"
        columns[f"joint_1.{name} [{unit}]"] = values + noise * generator.normal(size=len(samples.time))
    return save(path, ",".join(columns), *(values[::every] for values in columns.values()))


def save(path, header, *columns):
    """Write columns as a table of text, and return its path."""
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.12g")
    return path


def prepared(stack, folder, columns, free, *, keys="", **numbers):
    """Prepared fit to a table of columns by heading. numbers: those of the robot; keys: further keys of the scenario."""
    table = save(folder / "a.csv", ",".join(columns), *columns.values())
    scenario = write(folder, "lab", {**SEA, **numbers}, duration=float(columns["time [s]"][-1]))
    scenario.write_text(f"{scenario.read_text()}compiled: false\n{keys}")
    return set_up(task_of(scenario, [table], free=free), stack).problem


def bench(folder, stiffness):
    """Write the scenario of a spring on a bench for recordings of 4 s, and return its path."""
    lab = write(folder, "lab", {**SEA, "mode": 2, "tags": f"<spring_k>{stiffness}</spring_k>"}, duration=4.0)
    lab.write_text(lab.read_text().replace("engine: mujoco", "engine: bench") + "step: 0.005\n")
    return lab


BENCH = "time [s],joint_1.motor_1_position [rad],joint_1.elastic_torque_1 [N m]"
"""Heading of a recording of a spring on a bench."""


class Model:
    """Replacement for the simulation of a recording: one channel whose residuals (m,) are a function of the vector (n,)."""

    def __init__(self, left, layout, recorded, quantum):
        time = np.linspace(0.0, 1.0, len(recorded))
        channel = Channel(
            joint="j", quantity="link_position", unit="rad", time=time, values=recorded, noise=1.0, quantum=quantum
        )
        self.channels, self.onset, self.observes, self.motion, self.jumps, self.sampling = (channel,), 0.0, False, 0.0, [], 0.0
        self.data = SimpleNamespace(predicted_only=False, name="a", duration=1.0, commands=())
        self._left, self._layout = left, layout

    def predictions(self, tables, playing, until):
        for table in tables:
            left = self._left(np.array([one.place(table.get(one.key, one.start)) for one in self._layout.entries]))
            whole = [(np.nan if left is None else left) + channel.values for channel in self.channels]
            yield [values[: self.channels[0].until(until)] for values in whole]

    def predict(self, values, playing, until):
        return next(self.predictions([values], playing, until))


def modelled(left, entries, samples, *, recorded=None, quantum=0.0, weight=1.0):
    """Problem whose residuals are a function of the parameter vector. entries: parameters, or a number of unit parameters."""
    names = "abcdefgh"[: entries if isinstance(entries, int) else 0]
    parameters = [FitParameter(key=name, unit="", start=1.0) for name in names] or entries
    layout = make_layout(parameters, (), ["a"], [{}], [{}])
    track = Model(left, layout, np.zeros(samples) if recorded is None else recorded, quantum)
    return FitProblem((track,), layout, Playing((1, 1)), ((weight,),), (1.0,), Meter())
