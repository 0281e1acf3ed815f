"""Environments of Gymnasium: `gymnasium.make_vec("BalloonWarp/Altitude-v0", num_envs=64)`, once this is imported.

Here are the tasks by their names, as Gymnasium makes them, and a single world of one. Read `tasks` next, what a task is
and those that are ours; `vector_env` has many worlds of a task on one device or several GPUs, and `stable_baselines`,
`rl_games` and `rsl_rl` fit them to learners.
"""

from importlib.util import find_spec
from typing import Any, overload

import numpy as np

from balloon_warp.errors import InputError, MissingExtraError

if not find_spec("gymnasium"):
    raise MissingExtraError("balloon_warp.learn needs gymnasium: pip install 'balloon-warp[envs]'")

import gymnasium
from gymnasium.vector import AutoresetMode

from balloon_warp.learn.tasks import Altitude, Inflate, Juggle, Press, Target, Task
from balloon_warp.learn.vector_env import RENDER_MODES, BalloonVectorEnv, SpreadVectorEnv, Unpickled

__all__ = ["BalloonVectorEnv", "SpreadVectorEnv", "Task", "make", "make_vec", "task_named"]


class BalloonEnv(Unpickled, gymnasium.Env[Any, Any]):
    """A world of a task; many of them are a `BalloonVectorEnv`, which is as fast as one.

    Args:
        task: scene, actions, observations and rewards.
        device: Warp device; the GPU, or else the CPU, if not given.
        render_mode: "rgb_array", "human" for a page in the browser, or nothing.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 60}  # noqa: RUF012 - as Gymnasium has it

    def __init__(self, task: Task, device: str | None = None, render_mode: str | None = None):
        self._worlds = BalloonVectorEnv(
            task, 1, device=device, autoreset_mode=AutoresetMode.DISABLED, render_mode=render_mode
        )
        self.render_mode = render_mode
        self.observation_space = self._worlds.single_observation_space
        self.action_space = self._worlds.single_action_space

    @property
    def onlooker(self) -> Any:
        """Page of render mode "human", from the first reset on."""
        return self._worlds.onlooker

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset; random values follow from the seed and the episode."""
        super().reset(seed=seed)
        observations, info = self._worlds.reset(seed=seed)
        return observations[0], info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Advance by the frames of a step."""
        observations, rewards, terminated, truncated, info = self._worlds.step(np.asarray(action)[None])
        told = {"cause": int(info["cause"][0])}
        return observations[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), told

    def render(self) -> Any:
        """Return a picture, shape (height, width, 3), uint8."""
        pictures = self._worlds.render()
        return pictures[0] if pictures else None

    def close(self) -> None:
        """Close the environment, which then refuses `reset`, `step` and `render`."""
        self._worlds.close()


TASKS: dict[str, type[Task]] = {each.__name__: each for each in (Altitude, Inflate, Juggle, Press, Target)}
NAMESPACE, VERSION = "BalloonWarp", "v0"


def task_named(name: str) -> Task:
    """Return a task by its name, such as "Altitude".

    Raises:
        InputError: there is none.
    """
    if name not in TASKS:
        raise InputError(f"{name}: no such task; known are {', '.join(TASKS)}")
    return TASKS[name]()


@overload
def make_vec(
    task: str | Task = ..., num_envs: int = ..., *, gpus: None = None, workers: None = None, **options: Any
) -> BalloonVectorEnv: ...


@overload
def make_vec(
    task: str | Task = ..., num_envs: int = ..., *, gpus: int, workers: None = None, **options: Any
) -> SpreadVectorEnv: ...


@overload
def make_vec(
    task: str | Task = ..., num_envs: int = ..., *, gpus: None = None, workers: int, **options: Any
) -> SpreadVectorEnv: ...


def make_vec(
    task: str | Task = "Altitude",
    num_envs: int = 1,
    *,
    gpus: int | None = None,
    workers: int | None = None,
    **options: Any,
) -> BalloonVectorEnv | SpreadVectorEnv:
    """Make many worlds of a task, as `gymnasium.make_vec` does; for options see `BalloonVectorEnv`.

    Args:
        gpus: number of GPUs of this machine, with a process for each: a `SpreadVectorEnv`.
        workers: number of processes on this machine's CPU, likewise.

    Raises:
        InputError: there is no such task, or a value cannot be.
    """
    chosen = task_named(task) if isinstance(task, str) else task
    if gpus is None and workers is None:
        return BalloonVectorEnv(chosen, num_envs, **options)
    if options.pop("device", None):
        raise InputError("device: cannot be given with gpus or workers, which say where worlds are")
    return SpreadVectorEnv(chosen, num_envs, gpus=gpus, workers=workers, **options)


def make(task: str | Task = "Altitude", **options: Any) -> BalloonEnv:
    """Make a single world of a task, as `gymnasium.make` does."""
    return BalloonEnv(task_named(task) if isinstance(task, str) else task, **options)


def register_all() -> None:
    """Tell Gymnasium of all tasks."""
    for name in TASKS:
        gymnasium.register(
            id=f"{NAMESPACE}/{name}-{VERSION}",
            entry_point="balloon_warp.learn:make",
            vector_entry_point="balloon_warp.learn:make_vec",
            kwargs={"task": name},
        )


register_all()
