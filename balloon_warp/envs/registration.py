"""The tasks by their names, and how Gymnasium makes them."""

from typing import Any

import gymnasium

from balloon_warp.envs.altitude import Altitude
from balloon_warp.envs.inflate import Inflate
from balloon_warp.envs.juggle import Juggle
from balloon_warp.envs.press import Press
from balloon_warp.envs.single_env import BalloonEnv
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


def make_vec(task: str | Task = "Altitude", num_envs: int = 1, **options: Any) -> BalloonVectorEnv:
    """Make many worlds of a task, as `gymnasium.make_vec` does; for options see `BalloonVectorEnv`."""
    return BalloonVectorEnv(task_named(task) if isinstance(task, str) else task, num_envs, **options)


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
