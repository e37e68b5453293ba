"""Random robots against the independent solution `support.independent_ode`, for all engines, bases, jumps and modes."""

from dataclasses import replace

import numpy as np
import pinocchio
import pytest

import asrsim
from asrsim.kinematics import model_of
from asrsim.robot import load_robot
from asrsim.simulation.run import simulate
from support.convergence import check
from support.independent_ode import Truth
from support.random_runs import random_run
from validation.models import INSTALLED

Array = np.ndarray


@pytest.mark.parametrize(("seed", "fixed"), [(2, True), (7, True), (0, False), (3, False)])
def test_every_actuator_and_mode_at_second_order(tmp_path, seed, fixed):
    check(random_run(seed, fixed=fixed), tmp_path, INSTALLED)


@pytest.mark.parametrize("fixed", [True, False])
def test_passive_trees_at_second_order(tmp_path, fixed):
    """Robots have only links, springs and damping, which the engines compute."""
    check(random_run(901, moving=6, fixed=fixed, passive=1.0, jumps=False), tmp_path, INSTALLED, order=1.9)


@pytest.mark.parametrize(("seed", "fixed"), [(105, False), (112, True)])
def test_optional_models_converge_at_second_order(tmp_path, seed, fixed):
    """One robot has electric motors with limits, hysteresis, moving motors at the start, and delayed commands."""
    check(random_run(seed, moving=3, fixed=fixed, extras=True), tmp_path, INSTALLED[:1], order=1.5)


@pytest.mark.parametrize(("seed", "fixed"), [(101, True), (123, False)])
def test_energies_balance_at_second_order(tmp_path, seed, fixed):
    """The work of the motors equals the energy of springs and links plus heat and losses, with all optional models."""
    run = random_run(seed, moving=3, fixed=fixed, extras=True, friction=True)
    base = asrsim.make_scenario(run.write(tmp_path), engine=INSTALLED[0], compiled=False, **run.keys())
    first = simulate(base)
    finer = replace(base, substeps=4 * first.resolution.substeps, motor_substeps=first.resolution.motor_substeps)
    left = [np.nanmax(np.abs(result.samples.values["energy_residual"])) for result in (first, simulate(finer))]
    assert left[0] < 1e-3
    assert np.log2(left[0] / left[1]) / 2.0 > 1.7


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("seed", [5, 6])
def test_poses_and_slopes_of_all_links(tmp_path, engine, seed):
    """Links behind fixed joints are included, since engines merge them into one body."""
    run = random_run(seed)
    scenario = asrsim.make_scenario(run.write(tmp_path), engine=engine, **run.keys())
    truth = Truth(run)
    q = np.array([joint.start for joint in run.joints])
    placed = pinocchio.neutral(truth.model)
    placed[truth.q_of] = q
    pinocchio.computeJointJacobians(truth.model, truth.data, placed)
    pinocchio.updateFramePlacements(truth.model, truth.data)
    point = (0.1, -0.2, 0.3)
    with model_of(scenario, load_robot(scenario.robot)) as model:
        order = [model.joints.index(joint.name) for joint in run.joints]
        for link in model.links:
            frame = truth.model.getFrameId(link)
            pose = truth.data.oMf[frame]
            place, rotation, jacobian = model.link_point(link, point, q[np.argsort(order)])
            np.testing.assert_allclose(place, truth.rotation @ (pose.translation + pose.rotation @ point), atol=1e-9)
            np.testing.assert_allclose(rotation, truth.rotation @ pose.rotation, atol=1e-9)
            slopes = pinocchio.getFrameJacobian(truth.model, truth.data, frame, pinocchio.LOCAL_WORLD_ALIGNED)[:, truth.v_of]
            lever = pose.rotation @ point
            slopes[:3] += np.cross(slopes[3:].T, lever).T
            np.testing.assert_allclose(
                jacobian[:, order], np.vstack([truth.rotation @ slopes[:3], truth.rotation @ slopes[3:]]), atol=1e-9
            )
