"""The tasks by their names, and how Gymnasium makes them."""

from typing import Any, overload

import gymnasium

from balloon_warp.envs.altitude import Altitude
from balloon_warp.envs.inflate import Inflate
from balloon_warp.envs.juggle import Juggle
from balloon_warp.envs.press import Press
from balloon_warp.envs.single_env import BalloonEnv
from balloon_warp.envs.spread_env import SpreadVectorEnv
from balloon_warp.envs.target import Target
from balloon_warp.envs.task import Task
from balloon_warp.envs.vector_env import BalloonVectorEnv
from balloon_warp.errors import InputError

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
            entry_point="balloon_warp.envs.registration:make",
            vector_entry_point="balloon_warp.envs.registration:make_vec",
            kwargs={"task": name},
        )
