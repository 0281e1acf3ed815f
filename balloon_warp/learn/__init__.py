"""Environments of Gymnasium: `gymnasium.make_vec("BalloonWarp/Altitude-v0", num_envs=64)`, once this is imported.

Read `task` first, what a task is, then one of the tasks, such as `inflate`; `vector_env` has many worlds of a task on
one device, `spread_env` on several GPUs, and `stable_baselines`, `rl_games` and `rsl_rl` fit them to learners.
"""

from importlib.util import find_spec

from balloon_warp.errors import MissingExtraError

if not find_spec("gymnasium"):
    raise MissingExtraError("balloon_warp.learn needs gymnasium: pip install 'balloon-warp[envs]'")

from balloon_warp.learn.registration import make, make_vec, register_all, task_named
from balloon_warp.learn.spread_env import SpreadVectorEnv
from balloon_warp.learn.task import Task
from balloon_warp.learn.vector_env import BalloonVectorEnv

register_all()
__all__ = ["BalloonVectorEnv", "SpreadVectorEnv", "Task", "make", "make_vec", "task_named"]
