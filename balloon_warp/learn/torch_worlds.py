"""Worlds of an environment for learners that stay on its device: tensors of torch, reset in the step of their end."""

from typing import Any

import warp as wp
from gymnasium.vector import AutoresetMode

from balloon_warp.errors import InputError
from balloon_warp.learn.vector_env import BalloonVectorEnv


class TorchWorlds:
    """Worlds that begin anew in the step of their end.

    Args:
        env: of `make_vec(..., output="torch", autoreset_mode="SameStep")`.
        library: that asks for it.

    Raises:
        InputError: the environment tells NumPy's arrays, or resets worlds otherwise.
    """

    def __init__(self, env: BalloonVectorEnv, library: str):
        if env.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise InputError(
                f'autoreset_mode: {library} needs "SameStep", with output="torch" (got {env.autoreset_mode.value!r})'
            )
        self.env = env
        self.device = wp.device_to_torch(env.simulator.model.device)
        self.seen = self.reset()
        """Newest observations, shape (world_count, observations)"""

    def reset(self) -> Any:
        """Reset all worlds, and return the observations."""
        self.seen, _ = self.env.reset()
        if isinstance(self.seen, dict) or not hasattr(self.seen, "to"):
            raise InputError('output: must be "torch" (got "numpy")')
        return self.seen

    def step(self, actions: Any) -> tuple[Any, Any, Any, dict[str, Any]]:
        """Advance all worlds; return observations, rewards, terminations, and `time_outs`: ended by time alone.

        Actions beyond -1 and 1 count as these.
        """
        self.seen, rewards, terminated, truncated, _ = self.env.step(actions)
        return self.seen, rewards, terminated | truncated, {"time_outs": truncated & ~terminated}
