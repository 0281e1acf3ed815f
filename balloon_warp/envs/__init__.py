"""Environments of Gymnasium: `gymnasium.make_vec("BalloonWarp/Altitude-v0", num_envs=64)`, once this is imported."""

from importlib.util import find_spec

from balloon_warp.errors import MissingExtraError

if not find_spec("gymnasium"):
    raise MissingExtraError("balloon_warp.envs needs gymnasium: pip install 'balloon-warp[envs]'")

from balloon_warp.envs.registration import make, make_vec, register_all, task_named
from balloon_warp.envs.spread_env import SpreadVectorEnv
from balloon_warp.envs.task import Task
from balloon_warp.envs.vector_env import BalloonVectorEnv

register_all()

__all__ = ["BalloonVectorEnv", "SpreadVectorEnv", "Task", "make", "make_vec", "task_named"]
