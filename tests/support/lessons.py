"""Learning in simulation, and laboratory work between two trials: play an input on the robot, and record the motion."""

import numpy as np

from asrsim.learning import iterate
from asrsim.learning.plant import make_plant
from asrsim.learning.prepared import prepare_learning
from asrsim.scenario import load_scenario
from asrsim.signals.recorded import read_column
from asrsim.simulation.examine import examine


def plant_of(folder, arm, motion, duration, **ilc):
    """Model of an arm that learns a motion. ilc: further keys of the block `ilc`."""
    block = {"trajectory": motion, "tolerance": 0.005, "max_iterations": 15, **ilc}
    return make_plant(examine(load_scenario(arm.write(folder, duration=duration, initial="equilibrium", ilc=block))[0]))


def learned(plant):
    """(prepared, result) of learning in simulation."""
    prepared = prepare_learning(plant)
    return prepared, iterate(prepared.problem, plant.outputs, prepared.settings, law=prepared.law)


def play(robot, plant, inputs):
    """Link positions (n, joints) of the robot under equilibrium positions (n, joints)."""
    return robot.move(
        plant.time, lambda at: np.column_stack([np.interp(at, plant.time, column) for column in inputs.T]), step=1e-4
    )[:, :, 0]


def record(path, plant, robot, inputs, *, seed=0):
    """Write a recording of the robot at 200 Hz with 1 mrad of noise, and return the largest noise-free error in rad."""
    outputs = play(robot, plant, inputs)
    noisy = outputs[::5] + np.random.default_rng(seed).normal(0.0, 1e-3, outputs[::5].shape)
    header = ",".join(["time [s]", *(f"{joint}.link_position [rad]" for joint in plant.joints)])
    np.savetxt(path, np.column_stack([plant.time[::5], noisy]), delimiter=",", header=header, comments="")
    return float(np.abs(plant.reference - outputs).max())


def inputs_in(path, plant):
    """Inputs (n, joints) read from a file."""
    return np.column_stack([read_column(path, joint)[1] for joint in plant.joints])
