"""Environments for training: rewards of all at once, draws of a fit, pushes, delays, noise, histories, resets, pictures."""

import json

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not here")

import asrsim  # noqa: E402
from asrsim.errors import AsrsimError, InputError  # noqa: E402
from support.paths import EXAMPLES  # noqa: E402

RANGES = {"*": {"equilibrium_position": [-1.0, 1.0], "stiffness_preset": [0.05, 0.4]}}
ACTIONS = np.random.default_rng(3).uniform(-1.0, 1.0, (12, 3, 2))


def made(count=3, *, engine="mujoco", duration=0.2, ranges=RANGES, imperfections=None, **options):
    keys = {"engine": engine, "imperfections": imperfections}
    keys = {name: value for name, value in keys.items() if value is not None}
    scenario = asrsim.make_scenario(
        EXAMPLES / "urdf" / "dof2_horizontal.urdf", duration=duration, modes={"*": 6}, reference_ranges=ranges, **keys
    )
    return asrsim.make_vec_env(scenario, count, **options)


def played(env, actions=ACTIONS, seed=1):
    """Observations, rewards and ends of each step."""
    first, _ = env.reset(seed=seed)
    steps = [env.step(one) for one in actions]
    return np.array([first, *(step[0] for step in steps)]), np.array([step[1] for step in steps]), [step[2:] for step in steps]


def test_functions_of_all_states_give_what_functions_of_one_give():
    options = {"goal": {"x": "uniform(-1, 1)"}}

    def one(state):
        return float(-((state.values["link_position"][0] - state.goal["x"]) ** 2) + state.time + state.action[1])

    def every(states):
        return -((states.values["link_position"][:, 0] - states.goal["x"]) ** 2) + states.time + states.action[:, 1]

    singly = played(made(reward=one, terminated=lambda s: s.values["link_position"][1] > 0.1, **options))
    at_once = played(made(reward=every, terminated=lambda s: s.values["link_position"][:, 1] > 0.1, batched=True, **options))
    np.testing.assert_array_equal(singly[0], at_once[0])
    np.testing.assert_array_equal(singly[1], at_once[1])
    assert any(step[0].any() for step in at_once[2])
    for step, other in zip(singly[2], at_once[2], strict=True):
        np.testing.assert_array_equal(step[0], other[0])
    rewarded, ended = (
        played(made(batched=True, **own)) for own in ({"reward": every, **options}, {"terminated": lambda s: s.time > 9})
    )
    assert not any(step[0].any() for step in (*rewarded[2], *ended[2]))
    assert not ended[1].any()


def test_a_batched_reward_of_the_wrong_shape_is_refused():
    env = made(reward=lambda states: 0.0, batched=True)
    env.reset(seed=0)
    with pytest.raises(InputError, match="3 numbers, one for each environment"):
        env.step(ACTIONS[0])


def test_parameters_are_drawn_from_the_covariance_of_a_fit(tmp_path):
    keys = ["joint_1.damping", "link_2.mass"]
    covariance = [[0.01, 0.0099], [0.0099, 0.01]]
    mean = [float(np.log(0.05)), float(np.log(0.5))]
    path = tmp_path / "fit.json"
    path.write_text(json.dumps({"keys": keys, "mean": mean, "covariance": covariance, "logarithmic": True}))
    env = made(60, fit=str(path))
    _, infos = env.reset(seed=2)
    drawn = np.log([infos["parameters"][key] for key in keys])
    assert drawn.std(axis=1) == pytest.approx([0.1, 0.1], rel=0.35)
    assert np.corrcoef(drawn)[0, 1] > 0.9
    for i in (0, 59):
        masses = {link.name: link.mass for link in env.worlds.prepared_of(i).robot.links}
        assert masses["link_2"] == pytest.approx(np.exp(drawn[1, i]))


def test_a_larger_push_turns_a_resting_joint_farther():
    env = made(push={"joint_1": "uniform(0.05, 0.2)"})
    seen, *_ = played(env, np.zeros((4, 3, 2)))
    pushes = [episode.push["joint_1"] for episode in env.episodes]
    assert seen[-1, :, 0].min() > 1e-3
    assert np.argsort(seen[-1, :, 0]).tolist() == np.argsort(pushes).tolist()


def test_an_external_torque_can_be_an_action():
    ranges = {"*": {**RANGES["*"], "external_torque": [-0.2, 0.2]}}
    env = made(act=("joint_1.external_torque",), ranges=ranges)
    seen, *_ = played(env, np.array([[[1.0], [-1.0], [0.0]]] * 4))
    assert seen[-1, 0, 0] > 1e-3
    assert seen[-1, 1, 0] < -1e-3
    assert seen[-1, 2, 0] == pytest.approx(0.0, abs=1e-12)


def test_delayed_actions_are_the_actions_of_earlier_periods():
    """Two control periods of 20 ms: the scenario's reference, 0, acts until then."""
    late, *_ = played(made(delay=0.04), ACTIONS[:10])
    prompt, *_ = played(made(), np.concatenate([np.zeros((2, 3, 2)), ACTIONS])[:10])
    np.testing.assert_array_equal(late, prompt)
    drawn = made(30, delay="uniform(0, 0.04)")
    drawn.reset(seed=0)
    assert {episode.delay for episode in drawn.episodes} == {0, 1, 2}


def test_delays_of_commands_and_sensors_are_drawn_at_every_reset():
    """Each environment is one of a scenario that states its delays. The action sets joint_2; joint_1 follows its signal."""
    wave = {"joint_1": {"equilibrium_position": {"sinusoid": {"amplitude": 0.4, "frequency": 3.0}}}}
    keys = {"engine": "mujoco", "duration": 0.2, "modes": {"*": 6}, "reference_ranges": RANGES, "references": wave}
    laws = {"imperfections.sensors.*.delay": [0.0, 0.0031, 0.012], "imperfections.commands.joint_1.delay": "uniform(0, 0.02)"}

    def many(count, imperfections, **options):
        scenario = asrsim.make_scenario(EXAMPLES / "urdf" / "dof2_horizontal.urdf", imperfections=imperfections, **keys)
        return asrsim.make_vec_env(scenario, count, act="joint_2.equilibrium_position", **options)

    # Noise holds the sensors in place where the delay is 0.
    noisy = {"sensors": {"*": {"noise": 1e-4}}}
    env, actions = many(3, noisy, randomise=laws), ACTIONS[:9, :, :1]
    seen, *_ = played(env, actions)
    drawn = [episode.parameters for episode in env.episodes]
    assert len({values["imperfections.sensors.*.delay"] for values in drawn}) > 1
    for i, values in enumerate(drawn):
        late = {"commands": {"joint_1": {"delay": values["imperfections.commands.joint_1.delay"]}}}
        late["sensors"] = {"*": {"noise": 1e-4, "delay": values["imperfections.sensors.*.delay"]}}
        alone, *_ = played(many(1, late), actions[:, i : i + 1])
        np.testing.assert_array_equal(seen[:, i], alone[:, 0])
    with pytest.raises(InputError, match="upper bound"):
        many(1, noisy, randomise={"imperfections.sensors.*.delay": "normal(0.01, 0.002)"})


def test_noise_disturbs_what_is_observed_and_nothing_else():
    def reward(states):
        return states.values["link_position"][:, 0]

    noisy, plain = (made(reward=reward, batched=True, noise=noise) for noise in ({"link_position": 0.01}, {}))
    (seen, rewards, _), (exact, truth, _) = played(noisy), played(plain)
    np.testing.assert_array_equal(rewards, truth)
    np.testing.assert_array_equal(seen[..., 2:], exact[..., 2:])
    assert (seen[..., :2] - exact[..., :2]).std() == pytest.approx(0.01, rel=0.3)
    with pytest.raises(InputError, match="not observed"):
        made(noise={"stiffness": 1.0})


def test_a_history_holds_earlier_observations_and_actions():
    plain, *_ = played(made())
    seen, *_ = played(made(history=2))
    np.testing.assert_array_equal(seen[..., :4], plain)
    np.testing.assert_array_equal(seen[2:-3, :, 4:8], plain[1:-4])
    np.testing.assert_array_equal(seen[2:-3, :, 8:12], plain[:-5])
    np.testing.assert_allclose(seen[3, :, 12:], np.concatenate([ACTIONS[2], ACTIONS[1]], axis=1), rtol=1e-6)
    np.testing.assert_array_equal(seen[0, :, 4:8], plain[0])
    env = made(history=2)
    assert env.single_observation_space.shape == (16,)
    assert env.single_observation_space.contains(seen[0, 0])


def test_a_same_step_reset_begins_the_next_episode_at_once():
    env, late = made(duration=0.06, autoreset="same_step"), made(duration=0.06)
    env.reset(seed=4)
    late.reset(seed=4)
    for actions in ACTIONS[:3]:
        seen, _, _, truncated, infos = env.step(actions)
        last, *_ = late.step(actions)
    assert truncated.all()
    np.testing.assert_array_equal(np.stack(infos["final_obs"]), last)
    begun, *_ = late.step(ACTIONS[3])
    np.testing.assert_array_equal(seen, begun)
    with pytest.raises(InputError, match="next_step, same_step"):
        made(autoreset="never")


@pytest.mark.parametrize("how", ["same_step", "reset_mask"])
def test_a_reset_of_one_environment_leaves_the_others_as_they_are(how):
    """Environments 1 and 2 go on with the history and the noise that they have without the reset of environment 0."""
    options = {"history": 2, "noise": {"link_position": 0.01}}
    plain, *_ = played(made(**options), ACTIONS[:8])
    ends = {"autoreset": "same_step", "terminated": lambda state: state.action[0] > 5.0}
    env = made(**options, **(ends if how == "same_step" else {}))
    seen = [env.reset(seed=1)[0]]
    for k, actions in enumerate(ACTIONS[:8]):
        # The action beyond the range ends the episode.
        given = np.where(np.arange(3)[:, None] == 0, 9.0, actions) if how == "same_step" and k == 4 else actions
        seen.append(env.step(given)[0])
        if how == "reset_mask" and k == 4:
            seen[-1], _ = env.reset(options={"reset_mask": np.array([True, False, False])})
    np.testing.assert_array_equal(np.array(seen)[:, 1:], plain[:, 1:])
    assert (seen[5][0] != plain[5][0]).any()


def test_pictures_show_every_environment():
    env = made(2, render_mode="rgb_array", size=48)
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.array([[1.0, 0.0], [-1.0, 0.0]]))
    first, second = env.render()
    assert first.shape == second.shape == (48, 48, 3)
    assert (first != second).any()


def test_the_films_of_gymnasium_record_environments(tmp_path):
    pytest.importorskip("moviepy")
    from gymnasium.wrappers.vector import RecordVideo

    env = RecordVideo(made(2, duration=0.1, render_mode="rgb_array", size=32), str(tmp_path), episode_trigger=lambda _: True)
    env.reset(seed=0)
    for actions in ACTIONS[:7, :2]:
        env.step(actions)
    env.close()
    assert any(path.stat().st_size for path in tmp_path.glob("*.mp4"))


def test_many_worlds_are_in_mujoco_unless_told_otherwise():
    pytest.importorskip("pybullet")
    assert made(1, engine=None).worlds.prepared.scenario.engine == "mujoco"
    assert made(1, engine="bullet").worlds.prepared.scenario.engine == "bullet"
    assert made(1, engine=None, threads=1, observe="link_position").task.prepared.scenario.engine == "mujoco"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"noise": {"link_position": -1.0}}, "noise.link_position.*at least 0"),
        ({"history": 11}, "history.*0 to 10 control periods"),
        ({"history": True}, "history.*number of control periods"),
        ({"delay": -0.02}, r"delay.*0 to 0\.2 s"),
        ({"delay": "normal(0.02, 0.01)"}, r"delay.*0 to 0\.2 s"),
        ({"control_rate": float("nan")}, "control_rate.*above 0 Hz"),
        ({"randomise": {"joint_1.damping": [-1.0]}}, "joint_1.damping.*at least 0"),
        ({"randomise": {"imperfections.sensors.joint_9.delay": [0.01]}}, "joint_9.delay.*has no effect.*joint_1, joint_2"),
        ({"count": 1.5}, "num_envs.*whole number"),
        ({"threads": 0}, "threads.*whole number"),
        ({"device": "cuda"}, "device.*worlds on Warp only"),
        ({"imperfections": {"commands": {"joint_1": {"delay": 0.1}}}}, "commands of 'joint_1' would not act"),
    ],
)
def test_a_wrong_option_is_refused_when_the_environment_is_made(options, words):
    with pytest.raises(AsrsimError, match=words):
        made(**options)
