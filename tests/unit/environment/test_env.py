"""The Gymnasium environment: the interface's own checker, seeds and bits, resets, randomised parameters, pictures."""

import math
from functools import partial

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

import asrsim  # noqa: E402
from asrsim.engines import ENGINES, Engine, EngineEntry  # noqa: E402
from asrsim.environment import make_env, make_vec_env  # noqa: E402
from asrsim.environment.draws import Draws  # noqa: E402

RANDOM = {
    "joint_1.damping": "uniform(0.01, 0.2)",
    "link_2.mass": "normal(0.5, 0.05)",
    "parameters.joint_1.spring_k_1": "loguniform(0.002, 0.01)",
    "references.*.stiffness_preset": [0.1, 0.2, 0.3],
}
QUIET = pytest.mark.filterwarnings("ignore::UserWarning")


@pytest.fixture
def scenario(tmp_path):
    """A quick one: two joints, in plain Python."""
    from asrsim.runs.examples import examples_folder

    path = tmp_path / "scenario.yaml"
    path.write_text(
        f"robot: {examples_folder()}/urdf/dof2_horizontal.urdf\nduration: 0.2\nengine: mujoco\ncompiled: false\n"
        "references: {'*': {equilibrium_position: 0.0, stiffness_preset: 0.2}}\n"
        "reference_ranges: {'*': {equilibrium_position: [-1, 1], stiffness_preset: [0.05, 0.4]}}\n"
    )
    return path


def rollout(env, seed, count=8):
    observation, _ = env.reset(seed=seed)
    found, chance = [observation], np.random.default_rng(seed)
    for _ in range(count):
        observation, reward, *_ = env.step(chance.uniform(-1, 1, env.action_space.shape))
        found.append(np.append(observation, reward))
    return np.concatenate(found)


@QUIET
def test_the_checker_of_gymnasium_finds_nothing(scenario):
    check_env(make_env(scenario, goal={"x": "uniform(0, 1)"}, randomise=RANDOM, render_mode="rgb_array", size=48))


@pytest.mark.parametrize("options", [{}, {"randomise": RANDOM, "initial": {"joint_1": "uniform(-0.5, 0.5)"}}])
def test_equal_seeds_give_equal_bits_after_each_reset(scenario, options):
    env, other = make_env(scenario, **options), make_env(scenario, **options)
    first = rollout(env, 1)
    rollout(env, 2)
    np.testing.assert_array_equal(rollout(env, 1), first)
    np.testing.assert_array_equal(rollout(other, 1), first)
    assert (rollout(other, 2)[6:] != first[6:]).any()


def test_an_environment_is_the_simulation(scenario):
    env = make_env(scenario, control_rate=100, observe=("link_position", "motor_1_position", "elastic_torque_1", "stiffness"))
    env.reset()
    simulation = asrsim.Simulation(scenario, record=True)
    actions = np.random.default_rng(0).uniform(-1, 1, (10, 2))
    for action in actions:
        observation, *_ = env.step(action)
        for joint, value in zip(simulation.joints, action, strict=True):
            simulation.set_reference(joint, "equilibrium_position", value)
        simulation.advance(10)
    np.testing.assert_array_equal(observation[:2], simulation.observe().link_position.astype(np.float32))
    simulation.advance(2)
    simulation.flush()
    kept = simulation.recording.kept[-1]
    np.testing.assert_allclose(observation[6:8], kept.values["stiffness"][100], rtol=0.02)
    np.testing.assert_allclose(observation[4:6], kept.values["elastic_torque_1"][100], atol=0.02)


def test_what_is_randomised_changes_the_simulation(scenario):
    env = make_env(scenario, randomise={"link_2.mass & link_1.mass": "uniform(0.3, 0.9)"})
    masses = []
    for seed in range(3):
        _, info = env.reset(seed=seed)
        masses.append(info["parameters"]["link_2.mass"])
        links = {link.name: link for link in env.worlds.prepared_of(0).robot.links}
        assert links["link_1"].mass == links["link_2"].mass == masses[-1]
    assert len(set(masses)) == 3
    assert all(0.3 < mass < 0.9 for mass in masses)


def test_actions_are_scaled_to_the_ranges_and_cut(scenario):
    env = make_env(scenario, act=("stiffness_preset", "joint_1.equilibrium_position"), observe=("reference_1", "reference_2"))
    assert env.action_names == ("joint_1.stiffness_preset", "joint_2.stiffness_preset", "joint_1.equilibrium_position")
    assert make_env(scenario, act=None).action_names == make_env(scenario).action_names
    env.reset()
    found, *_ = env.step(np.array([-1.0, 1.0, 7.0]))
    np.testing.assert_allclose(found[[0, 2, 3]], [1.0, 0.05, 0.4])


def test_rewards_see_goal_and_tip_and_may_end_the_episode(scenario):
    seen = []
    env = make_env(
        scenario,
        observe=("tip",),
        tip=("link_2", (0.1, 0.0, 0.0)),
        goal={"x": [0.5]},
        reward=lambda state: state.goal["x"],
        terminated=lambda state: seen.append(state) or len(seen) == 3,
    )
    observation, _ = env.reset(seed=0)
    np.testing.assert_allclose(observation, [0.19, 0.0, 0.1, 0.5], atol=1e-6)
    results = [env.step(np.zeros(2)) for _ in range(3)]
    assert [result[1:3] for result in results] == [(0.5, False), (0.5, False), (0.5, True)]
    assert seen[1].time == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("functions", "wanted", "over"),
    [
        ({}, 0.0, False),
        ({"terminated": lambda state: state.time > 0.05}, 0.0, True),
        ({"reward": lambda state: 2.0}, 2.0, False),
    ],
)
def test_without_a_reward_it_is_zero_and_without_an_end_the_episode_is_cut(scenario, functions, wanted, over):
    env, many = (make(scenario, control_rate=10.0, **functions) for make in (make_env, partial(make_vec_env, num_envs=2)))
    env.reset(seed=0)
    many.reset(seed=0)
    _, reward, terminated, truncated, _ = env.step(env.action_space.sample())
    assert (reward, terminated, truncated) == (wanted, over, False)
    _, rewards, ended, cut, _ = many.step(many.action_space.sample())
    assert (rewards.tolist(), ended.tolist(), cut.tolist()) == ([wanted] * 2, [over] * 2, [False] * 2)
    if not over:
        assert env.step(env.action_space.sample())[1:4] == (wanted, False, True)


def test_an_episode_terminated_in_its_last_step_is_not_truncated(scenario):
    """10 steps of 20 ms; an action is seen as it was given, though its references are cut to their ranges."""
    seen = []
    env = make_env(scenario, reward=lambda state: seen.append(state.action) or 0.0, terminated=lambda state: state.time > 0.19)
    for step in range(2):
        env.reset()
        results = [env.step(np.array([0.3, -7.0 + step]))[2:4] for _ in range(10)]
        assert results == [(False, False)] * 9 + [(True, False)]
    np.testing.assert_array_equal(seen, [[0.3, -7.0]] * 10 + [[0.3, -6.0]] * 10)
    patient = make_env(scenario)
    patient.reset()
    assert [patient.step(np.zeros(2))[2:4] for _ in range(10)][-1] == (False, True)


def test_the_picture_moves_with_the_arm(scenario):
    env = make_env(scenario, render_mode="rgb_array", size=96)
    env.reset()
    before = env.render()
    for _ in range(5):
        env.step(np.ones(2))
    after = env.render()
    assert before.dtype == np.uint8
    assert (before != after).any(axis=2).mean() > 0.01
    assert make_env(scenario).render() is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"observe": ("link_positon",)}, "Did you mean 'link_position'"),
        ({"observe": ("tip",)}, "needs the option tip"),
        ({"tip": ("link_2", (0.0, 0.0))}, "three finite numbers"),
        ({"act": ("reference_1",)}, "no joint has a reference"),
        ({"control_rate": 300}, "not a whole number of steps"),
        ({"tip": ("hand", (0, 0, 0))}, "has no link 'hand'"),
        ({"randomise": {"link_9.mass": [1]}}, "no key, joint or link"),
        ({"randomise": {"step": [0.001]}}, "read again"),
        (
            {"randomise": {"joint_1.motor_1_damping": [0.1]}, "overrides": {"initial": "equilibrium"}},
            "the start, `initial: equilibrium`, depends on it: state another `initial`",
        ),
        ({"initial": {"elbow": [0.1]}}, "initial.elbow: the robot has no moving joint"),
        ({"initial": {"joint_1": "uniform(1, 3)"}}, "initial.joint_1: lies outside the limits"),
        ({"control_rate": "fast", "observe": 3}, "(?s)control_rate: must be a number.*observe: must be a name"),
        ({"act": [3], "goal": {3: [0.1]}}, "(?s)act: must be a name.*goal: must be a mapping from keys"),
        ({"observes": "link_position"}, "observes: is not an option.*Did you mean 'observe'"),
    ],
)
def test_wrong_arguments_are_refused(scenario, options, message):
    with pytest.raises(asrsim.InputError, match=message):
        make_env(scenario, **options)


@pytest.mark.parametrize("reward", [None, math.nan])
def test_a_reward_that_is_no_number_is_refused(scenario, reward):
    env = make_env(scenario, reward=lambda _: reward)
    env.reset()
    with pytest.raises(asrsim.InputError, match="reward: must return a number"):
        env.step(np.zeros(2))


@pytest.mark.parametrize("action", [[0.0], [0.0, np.nan], [[0.0, 0.0]]])
def test_wrong_actions_are_refused(scenario, action):
    env = make_env(scenario)
    env.reset()
    with pytest.raises(asrsim.InputError, match="2 finite numbers"):
        env.step(np.array(action))


@pytest.mark.parametrize("mode", [3, 6])
def test_an_episode_begins_with_what_a_run_logs_first(scenario, mode):
    """Torques, stiffness, references and ideal motors, too, of which a simulation that has not stepped knows nothing."""
    observed = ["link_position", "link_torque", "elastic_torque_1", "stiffness", "reference_1", "motor_1_position"]
    observed += ["motor_1_torque", "friction_torque_1"] if mode == 6 else []
    overrides = {"modes": mode, "initial": {"joint_1": 0.3}, "references.joint_1.equilibrium_position": 0.5}
    env = make_env(scenario, observe=observed, overrides=overrides)
    first, _ = env.reset(seed=1)
    result = asrsim.run(scenario, overrides=overrides)
    logged = [result[joint][name][0] for name in observed for joint in result.joints]
    np.testing.assert_allclose(first, logged, rtol=1e-6, atol=1e-7)
    assert np.count_nonzero(first) >= 5  # start, reference, motors, stiffness
    # The look ahead is taken back.
    moved, plain = env, make_env(scenario, overrides=overrides)
    plain.reset(seed=1)
    for _ in range(3):
        seen, other = moved.step(np.zeros(2))[0], plain.step(np.zeros(2))[0]
    np.testing.assert_array_equal(seen[:2], other[:2])


def test_every_draw_lies_within_its_bounds():
    laws = {
        "a": "uniform(-2, 3)",
        "b": "loguniform(0.1, 10)",
        "c": "normal(1, 0.5)",
        "d": "lognormal(1, 1)",
        "e": [4, -1, 2.5],
        "f & g": "uniform(1, 2)",
    }
    draws, chance = Draws(laws), np.random.default_rng(3)
    lows, highs = draws.bounds()
    assert draws.keys == ("a", "b", "c", "d", "e", "f", "g")
    np.testing.assert_array_equal(lows, [-2.0, 0.1, -np.inf, 0.0, -1.0, 1.0, 1.0])
    np.testing.assert_array_equal(highs, [3.0, 10.0, np.inf, np.inf, 4.0, 2.0, 2.0])
    found = np.array([list(draws.draw(chance).values()) for _ in range(400)])
    assert (found >= lows).all()
    assert (found <= highs).all()
    np.testing.assert_array_equal(found[:, 5], found[:, 6])


class Still(Engine):
    """Links that never move. The engine has only the members without a default."""

    version, state = "still 1", None

    def __init__(self, robot):
        self.joints = tuple(joint.name for joint in robot.moving_joints)

    def start(self, positions, velocities, *, step, staggered, implicitness):
        return positions, velocities

    def step(self, exchange, wrenches, lengths):
        pass

    def vary(self, robot):
        return True


def test_a_robot_in_an_engine_without_a_scene_of_its_own_has_the_same_picture(scenario):
    ENGINES.add("still", EngineEntry(make=lambda scenario, robot: (Still(robot), ()), doc="still"))
    pictures = []
    for engine in ("mujoco", "still"):
        env = make_env(scenario, overrides={"engine": engine}, render_mode="rgb_array", size=48)
        env.reset()
        pictures.append(env.render())
    np.testing.assert_array_equal(*pictures)
