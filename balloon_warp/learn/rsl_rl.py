"""Many worlds of a task as RSL-RL takes them: `OnPolicyRunner(RslRlEnv(env), config).learn(100)`."""

from importlib.util import find_spec
from typing import Any

import warp as wp

from balloon_warp.errors import MissingExtraError
from balloon_warp.learn.vector_env import BalloonVectorEnv, TorchWorlds

if not find_spec("rsl_rl"):
    raise MissingExtraError("balloon_warp.learn.rsl_rl needs RSL-RL 3 or newer: pip install rsl-rl-lib")

from rsl_rl.env import VecEnv  # pyright: ignore[reportMissingImports]
from tensordict import TensorDict  # pyright: ignore[reportMissingImports]

GROUP = "policy"
"""Name of the observations, by which a configuration asks for them"""


class RslRlEnv(VecEnv):
    """Worlds of an environment, for RSL-RL. Observations are the group `policy`.

    Args:
        env: of `make_vec(..., output="torch", autoreset_mode="SameStep")`.

    Raises:
        InputError: the environment tells NumPy's arrays, or resets worlds otherwise.
    """

    def __init__(self, env: BalloonVectorEnv):
        self.worlds = TorchWorlds(env, "RSL-RL")
        self.num_envs, self.num_actions = env.num_envs, env.task.actions
        self.max_episode_length, self.device = env.task.most_steps, self.worlds.device
        self.cfg: dict[str, Any] = {"task": type(env.task).__name__}
        self._steps = wp.to_torch(env.episode_steps)

    @property
    def episode_length_buf(self) -> Any:
        """Steps of each world since its episode began, shape (num_envs,)."""
        return self._steps

    @episode_length_buf.setter
    def episode_length_buf(self, steps: Any) -> None:
        self._steps.copy_(steps)

    def get_observations(self) -> Any:
        """Return the newest observations."""
        return self._told(self.worlds.seen)

    def reset(self) -> tuple[Any, dict[str, Any]]:
        """Begin all worlds anew."""
        return self._told(self.worlds.reset()), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, dict[str, Any]]:
        """Advance all worlds by the frames of a step."""
        seen, rewards, over, told = self.worlds.step(actions)
        return self._told(seen), rewards, over, told

    def close(self) -> None:
        """Close the environment."""
        self.worlds.env.close()

    def _told(self, seen: Any) -> Any:
        return TensorDict({GROUP: seen}, batch_size=[self.num_envs], device=self.device)
