"""Environments on several GPUs, or in processes of a CPU."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
import warp as wp

from balloon_warp import InputError, WorkersLostError
from balloon_warp.learn import BalloonVectorEnv, SpreadVectorEnv, make_vec
from balloon_warp.learn.target import Target

WORLDS, STEPS = 5, 7


class Brief(Target):
    """Task with episodes of four steps."""

    most_steps = 4


def actions_of(step: int, worlds: int = WORLDS) -> Any:
    """Return actions that differ by world and step."""
    rows = [np.random.default_rng((world, step)).uniform(-1.0, 1.0, 3) for world in range(worlds)]
    return np.array(rows, dtype=np.float32)


def returns_by_policy(env: BalloonVectorEnv, steps: int, scale: float) -> Any:
    """Return the sum of each world's rewards, by the task's own policy, and the process that found it."""
    observations, _ = env.reset(seed=3)
    sums = np.zeros(env.num_envs)
    for _ in range(steps):
        observations, rewards, *_ = env.step(scale * env.task.policy(observations))
        sums += rewards
    return sums, os.getpid()


def end_yourself(env: BalloonVectorEnv) -> None:
    """End the process without a word, if it has the first world."""
    if env.simulator.starts.first_world == 0:
        os._exit(3)
    time.sleep(60.0)


@pytest.fixture(scope="module")
def spread() -> Iterator[SpreadVectorEnv]:
    env = make_vec(Brief(), WORLDS, workers=2, autoreset_mode="SameStep")
    yield env
    env.close()


def test_worlds_have_the_bits_of_a_single_process(spread: SpreadVectorEnv):
    whole = make_vec(Brief(), WORLDS, device="cpu", autoreset_mode="SameStep")
    assert [len(worlds) for worlds in spread.parts] == [2, 3]
    first = [env.reset(seed=11)[0] for env in (whole, spread)]
    np.testing.assert_array_equal(*first)
    for step in range(STEPS):
        (*arrays, info), (*others, other_info) = (env.step(actions_of(step)) for env in (whole, spread))
        for array, other in zip(arrays, others, strict=True):
            np.testing.assert_array_equal(other, array)
            assert other.dtype == array.dtype
        np.testing.assert_array_equal(other_info["final_obs"], info["final_obs"])
        np.testing.assert_array_equal(other_info["cause"], info["cause"])
    mask = np.array([0, 1, 0, 0, 1])
    again = [env.reset(options={"reset_mask": mask})[0] for env in (whole, spread)]
    np.testing.assert_array_equal(*again)


def test_a_policy_sits_in_each_process(spread: SpreadVectorEnv):
    whole = make_vec(Brief(), WORLDS, device="cpu", autoreset_mode="SameStep")
    told = spread.on_each(returns_by_policy, STEPS, 0.5)
    np.testing.assert_array_equal(np.concatenate([sums for sums, _ in told]), returns_by_policy(whole, STEPS, 0.5)[0])
    assert len({os.getpid(), *(process for _, process in told)}) == 3
    steps = 3
    assert spread.on_each(lambda env: env.num_envs * steps) == [6, 9]  # a closure travels, too


def is_gone(process: int, seconds: float = 10.0) -> bool:
    """Return whether a process has ended, or does so soon."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def test_a_process_that_ends_ends_all():
    env = make_vec(Brief(), 2, workers=2)
    processes = env.on_each(lambda _: os.getpid())
    with pytest.raises(WorkersLostError, match=r"workers 2: process 0 ended"):
        env.on_each(end_yourself)
    assert all(is_gone(process) for process in processes)


def test_what_a_function_raises_is_raised_here_and_ends_all():
    """Gymnasium makes such an environment by its name."""
    env: Any = gymnasium.make_vec("BalloonWarp/Target-v0", num_envs=2, workers=2)
    assert isinstance(env, SpreadVectorEnv)
    processes = env.on_each(lambda _: os.getpid())

    def fail(env: BalloonVectorEnv) -> None:
        raise ValueError(f"world {env.simulator.starts.first_world}")

    with pytest.raises(ValueError, match=r"world [01]"):
        env.on_each(fail)
    assert all(is_gone(process) for process in processes)
    with pytest.raises(WorkersLostError, match=r"workers 2: the processes have ended"):
        env.step(np.zeros((2, 3)))


SCRIPT = """
import os, time
from balloon_warp.learn import make_vec

def wait(env):
    os.write(1, b"waits\\n")
    time.sleep(600)

if __name__ == "__main__":
    env = make_vec("Target", 2, workers=2)
    print("started", *env.on_each(lambda env: os.getpid()), flush=True)
    env.on_each(wait)
"""


def test_processes_are_gone_after_the_one_that_started_them(tmp_path):
    """SIGKILL leaves the parent no time to end them, and a function keeps them busy."""
    (tmp_path / "wait.py").write_text(SCRIPT)
    with subprocess.Popen([sys.executable, tmp_path / "wait.py"], stdout=subprocess.PIPE, text=True) as script:
        assert script.stdout is not None
        lines = iter(script.stdout.readline, "")
        processes = next([int(each) for each in line.split()[1:]] for line in lines if line.startswith("started"))
        for _ in processes:
            assert next(line for line in lines if line.startswith("waits"))
        assert len(processes) == 2
        script.send_signal(signal.SIGKILL)
    assert all(is_gone(process) for process in processes)


class Local:
    """Scope of a class that no other process finds."""

    def task(self) -> Target:
        class Hidden(Target):
            pass

        return Hidden()


MISTAKES = {
    "both": ({"gpus": 1, "workers": 1}, r"cluster, gpus, workers: expected only one of them"),
    "none": ({"workers": 0}, r"workers 0: expected at least 1"),
    "a device": ({"workers": 1, "device": "cpu"}, r"device: cannot be given with gpus or workers"),
    "too many": ({"gpus": 99}, rf"gpus 99: this machine has {wp.get_cuda_device_count()}"),
    "worlds": ({"workers": 1, "num_envs": 0}, r"num_envs: must be a whole number of at least 1 \(got 0\)"),
    "a schedule": ({"workers": 1, "num_envs": 1, "schedule": "fast"}, r"schedule fast: no such schedule"),
    "a task": ({"workers": 1, "num_envs": 1, "task": Local().task()}, r"task: cannot be sent to a process"),
}


@pytest.mark.parametrize(("options", "message"), MISTAKES.values(), ids=MISTAKES)
def test_bad_input_is_told_in_a_sentence(options: dict[str, Any], message: str):
    with pytest.raises(InputError, match=message):
        make_vec(**{"task": "Target", "num_envs": 2, **options})


def test_actions_and_masks_are_checked_before_they_are_sent(spread: SpreadVectorEnv):
    with pytest.raises(InputError, match=r"actions: expected shape \(5, 3\) \(got \(2, 3\)\)"):
        spread.step(np.zeros((2, 3)))
    with pytest.raises(InputError, match=r"reset: expected a value for each world, of shape \(5,\) \(got \(2,\)\)"):
        spread.reset(options={"reset_mask": [0, 1]})
    spread.step(actions_of(0))  # it goes on


@pytest.mark.skipif(wp.get_cuda_device_count() < 2, reason="needs two GPUs")
def test_two_gpus_have_the_bits_of_one():
    """Tensors of a policy stay on its GPU."""
    torch = pytest.importorskip("torch")
    one, two = make_vec(Brief(), 300, device="cuda:0"), make_vec(Brief(), 300, gpus=2, output="torch")
    np.testing.assert_array_equal(one.reset(seed=5)[0], two.reset(seed=5)[0])
    for step in range(STEPS):
        ours, theirs = (env.step(actions_of(step, 300)) for env in (one, two))
        for array, other in zip(ours[:4], theirs[:4], strict=True):
            np.testing.assert_array_equal(array, other)

    def observe(env: BalloonVectorEnv) -> tuple[str, bool]:
        observations, _ = env.reset(seed=5)
        return os.environ["CUDA_VISIBLE_DEVICES"], isinstance(observations, torch.Tensor) and observations.is_cuda

    told = two.on_each(observe)
    assert len({name for name, _ in told}) == 2
    assert all(is_tensor for _, is_tensor in told)
    two.close()
