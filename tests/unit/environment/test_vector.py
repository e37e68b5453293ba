"""Many environments that are stepped together."""

import pickle

import numpy as np
import pytest

from support.paths import ROOT

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not here")

import asrsim  # noqa: E402

URDF = ROOT / "examples" / "urdf" / "dof2_horizontal.urdf"
KEYS = {
    "duration": 0.2,
    "engine": "mujoco",
    "modes": {"*": 6},
    "reference_ranges": {"*": {"equilibrium_position": [-1.0, 1.0], "stiffness_preset": [0.05, 0.4]}},
}
DRAWN = {
    "randomise": {"link_2.mass": "uniform(0.3, 0.9)", "joint_1.damping": "uniform(0.0, 0.1)"},
    "initial": {"joint_1": "uniform(-0.5, 0.5)"},
    "goal": {"x": "uniform(0, 1)"},
}
OBSERVED = ("link_position", "link_velocity", "motor_1_position", "stiffness", "link_torque")


def reward(state):
    """Of what is seen and wanted."""
    return float(state.values["link_position"][0] - state.goal["x"] + state.time)  # type: ignore[attr-defined]


def environments(count, **options):
    scenario = asrsim.make_scenario(URDF, **KEYS)
    return asrsim.make_vec_env(scenario, count, observe=OBSERVED, reward=reward, **{**DRAWN, **options})


@pytest.mark.parametrize("threads", [1, 2])
def test_each_environment_has_the_bits_of_one_alone(threads):
    """Through resets, which come by themselves, with what is drawn at each."""
    many = environments(3, threads=threads)
    alone = [asrsim.make_env(asrsim.make_scenario(URDF, **KEYS), observe=OBSERVED, reward=reward, **DRAWN) for _ in range(3)]
    observations, told = many.reset(seed=7)
    over = [False] * 3
    for i, env in enumerate(alone):
        first, info = env.reset(seed=7 + i)
        np.testing.assert_array_equal(observations[i], first)
        assert told["goal"]["x"][i] == info["goal"]["x"]
    for actions in np.random.default_rng(0).uniform(-1.0, 1.0, (25, 3, 2)).astype(np.float32):
        observations, rewards, ended, truncated, told = many.step(actions)
        for i, env in enumerate(alone):
            if over[i]:
                first, info = env.reset()
                expected = first, 0.0, False, False
                assert told["goal"]["x"][i] == info["goal"]["x"]
                assert told["parameters"]["link_2.mass"][i] == info["parameters"]["link_2.mass"]
            else:
                expected = env.step(actions[i])[:4]
            np.testing.assert_array_equal(observations[i], expected[0])
            assert (rewards[i], ended[i], truncated[i]) == expected[1:]
            over[i] = expected[2] or expected[3]
    many.close()


def test_spaces_are_bounded_and_of_single_precision():
    many = environments(2)
    for space in (many.single_observation_space, many.single_action_space, many.observation_space, many.action_space):
        assert space.dtype == np.float32
        assert space.is_bounded()
    observation, _ = many.reset(seed=1)
    assert observation in many.observation_space
    assert many.observation_space.shape == (2, 11)


def test_a_copy_through_pickle_begins_like_the_original():
    scenario = asrsim.make_scenario(URDF, **KEYS)
    for made in (environments(2), asrsim.make_env(scenario, **DRAWN)):
        copy = pickle.loads(pickle.dumps(made))
        np.testing.assert_array_equal(copy.reset(seed=3)[0], made.reset(seed=3)[0])


def test_an_environment_that_diverges_ends_and_the_others_go_on():
    many = environments(2, randomise={"joint_1.damping": [0.0]}, act=("equilibrium_position",))
    many.reset(seed=0)
    many.worlds.set_reference("joint_1", "external_torque", [0.0, 1e305])
    _, _, ended, truncated, _ = many.step(np.zeros((2, 2)))
    assert ended.tolist() == [False, True]
    assert not truncated.any()
    observations, *_ = many.step(np.zeros((2, 2)))
    assert np.isfinite(observations).all()
