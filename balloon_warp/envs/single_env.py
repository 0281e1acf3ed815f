"""A single world of a task as an environment of Gymnasium."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from balloon_warp.envs.task import Task
from balloon_warp.envs.vector_env import RENDER_MODES, BalloonVectorEnv, Unpickled


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
