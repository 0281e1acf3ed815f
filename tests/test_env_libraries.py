"""Libraries that learn take environments: TorchRL, skrl and Stable-Baselines3, where they are installed."""

import importlib
import importlib.util
import sys
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from balloon_warp import InputError, MissingExtraError
from balloon_warp.envs import BalloonVectorEnv, make_vec
from balloon_warp.envs.target import Target

WORLDS, STEPS = 3, 6
CHANCE = np.random.default_rng(0)
ACTIONS = CHANCE.uniform(-1.0, 1.0, (STEPS, WORLDS, 3)).astype(np.float32)


class Brief(Target):
    """Task with episodes of four steps."""

    most_steps = 4


def brief(mode: str, **options: Any) -> BalloonVectorEnv:
    return BalloonVectorEnv(Brief(), WORLDS, device="cpu", autoreset_mode=AutoresetMode(mode), **options)


@pytest.fixture(scope="module")
def plain() -> tuple[list[Any], list[Any]]:
    """Observations that steps begin with, and what they bring, of our own environment."""
    env = brief("SameStep")
    seen, told = [env.reset(seed=5)[0]], []
    for actions in ACTIONS:
        told.append(env.step(actions))
        seen.append(told[-1][0])
    assert told[3][3].all()
    return seen, told


def last_seen(told: Any) -> np.ndarray:
    """Return what was seen at the end of a step, before worlds began anew."""
    return np.where(told[4]["_final_obs"][:, None], told[4]["final_obs"], told[0])


def test_the_mode_is_told_as_gymnasium_s_own_environments_tell_it():
    assert make_vec("Target", device="cpu").autoreset_mode is AutoresetMode.NEXT_STEP


@pytest.mark.parametrize("mode", ["SameStep", "Disabled"])
@pytest.mark.parametrize("output", ["numpy", "torch"])
def test_torchrl_s_wrapper_sees_the_same(mode: str, output: str, plain: tuple[list[Any], list[Any]]):
    """TorchRL gives observations before and after a step; it resets all worlds once more if all are over at once."""
    torchrl, torch = pytest.importorskip("torchrl.envs"), pytest.importorskip("torch")
    env = torchrl.GymWrapper(brief(mode, output=output))
    assert tuple(env.batch_size) == (WORLDS,)
    torchrl.check_env_specs(env)
    env = torchrl.GymWrapper(brief(mode, output=output))
    env.rollout(1)  # it needs one to see what is told beside observations
    now = told = env.reset(seed=5)
    for actions, seen, expected in zip(ACTIONS[: Brief.most_steps], plain[0], plain[1], strict=False):
        told, after = env.step_and_maybe_reset(now.set("action", torch.from_numpy(actions)))
        np.testing.assert_array_equal(told["observation"], seen)
        np.testing.assert_array_equal(told["next", "observation"], last_seen(expected))
        np.testing.assert_array_equal(told["next", "reward"][:, 0], expected[1])
        np.testing.assert_array_equal(told["next", "truncated"][:, 0], expected[3])
        now = after
    assert told["next", "truncated"].all()
    assert not now["truncated"].any()
    assert (now["observation"][:, 3:] == 0.0).all()  # at rest again


@pytest.mark.filterwarnings("ignore:To copy construct from a tensor")
@pytest.mark.parametrize("output", ["numpy", "torch"])
def test_skrl_s_wrapper_sees_the_same(output: str, plain: tuple[list[Any], list[Any]]):
    wrappers, torch = pytest.importorskip("skrl.envs.wrappers.torch"), pytest.importorskip("torch")
    inner = brief("SameStep", output=output)
    env = wrappers.wrap_env(inner, wrapper="gymnasium")
    assert env.num_envs == WORLDS
    env.reset()
    inner.reset(seed=5)
    for actions, expected in zip(ACTIONS, plain[1], strict=True):
        seen, rewards, terminated, truncated, _ = env.step(torch.from_numpy(actions))
        for found, wanted in zip((seen, rewards, terminated, truncated), expected, strict=False):
            np.testing.assert_array_equal(found, wanted.reshape(found.shape))


def test_stable_baselines_sees_the_same(plain: tuple[list[Any], list[Any]]):
    pytest.importorskip("stable_baselines3")
    from balloon_warp.envs.stable_baselines import StableBaselinesEnv

    env = StableBaselinesEnv(brief("SameStep"))
    env.seed(5)
    np.testing.assert_array_equal(env.reset(), plain[0][0])
    for actions, expected in zip(ACTIONS, plain[1], strict=True):
        seen, rewards, over, told = env.step(actions)
        np.testing.assert_array_equal(seen, expected[0])
        np.testing.assert_array_equal(rewards, expected[1])
        np.testing.assert_array_equal(over, expected[2] | expected[3])
        for world in range(WORLDS):
            assert bool(told[world]) == over[world]
            if over[world]:
                np.testing.assert_array_equal(told[world]["terminal_observation"], expected[4]["final_obs"][world])
                assert told[world]["TimeLimit.truncated"]
    assert env.get_attr("num_envs", [0, 2]) == [WORLDS, WORLDS]
    assert env.env_is_wrapped(object) == [False] * WORLDS


def test_stable_baselines_learns_a_little():
    """PPO of that library takes the environment, with its monitor around it."""
    library, vectors = (pytest.importorskip(f"stable_baselines3{part}") for part in ("", ".common.vec_env"))
    from balloon_warp.envs.stable_baselines import StableBaselinesEnv

    env = vectors.VecMonitor(StableBaselinesEnv(brief("SameStep")))
    learner = library.PPO("MlpPolicy", env, n_steps=6, batch_size=18, seed=0)
    learner.learn(36)
    assert learner.num_timesteps == 36
    assert {episode["l"] for episode in learner.ep_info_buffer} == {4}


def test_stable_baselines_needs_worlds_that_begin_anew_at_once():
    pytest.importorskip("stable_baselines3")
    from balloon_warp.envs.stable_baselines import StableBaselinesEnv

    with pytest.raises(InputError, match=r"autoreset_mode: Stable-Baselines3 needs \"SameStep\" \(got 'NextStep'\)"):
        StableBaselinesEnv(brief("NextStep"))


def test_stable_baselines_is_asked_for_where_it_is_missing(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.delitem(sys.modules, "balloon_warp.envs.stable_baselines", raising=False)
    with pytest.raises(MissingExtraError, match="needs Stable-Baselines3: pip install stable-baselines3"):
        importlib.import_module("balloon_warp.envs.stable_baselines")
