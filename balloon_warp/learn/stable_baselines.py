"""Many worlds of a task as Stable-Baselines3 takes them, which has vectors of environments of its own."""

from importlib.util import find_spec
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.learn.vector_env import BalloonVectorEnv

if not find_spec("stable_baselines3"):
    raise MissingExtraError(
        "balloon_warp.learn.stable_baselines needs Stable-Baselines3: pip install stable-baselines3"
    )

from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]


class StableBaselinesEnv(VecEnv):
    """Worlds of an environment, for Stable-Baselines3: `PPO("MlpPolicy", StableBaselinesEnv(env))`.

    Methods and attributes that are asked for by world are those of the one environment.

    Args:
        env: worlds that are reset in the step of their end, of `make_vec(..., autoreset_mode="SameStep")`, as NumPy.

    Raises:
        InputError: worlds are reset otherwise.
    """

    def __init__(self, env: BalloonVectorEnv):
        if env.autoreset_mode is not AutoresetMode.SAME_STEP:
            found = env.autoreset_mode.value
            raise InputError(f'autoreset_mode: Stable-Baselines3 needs "SameStep" (got {found!r})')
        self.env, self._actions = env, np.zeros(env.action_space.shape or (), dtype=np.float32)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> NDArray[Any]:
        """Begin all worlds anew, with the seed that `seed` gave if it did."""
        observations, _ = self.env.reset(seed=self._seeds[0])
        self._reset_seeds()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], list[dict[str, Any]]]:
        """Advance all worlds; those that are over tell their last observation, and whether it was time that ran out."""
        observations, rewards, terminated, truncated, info = self.env.step(self._actions)
        over = terminated | truncated
        told: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for world in np.flatnonzero(over):
            told[world] = {
                "terminal_observation": info["final_obs"][world],
                "TimeLimit.truncated": bool(truncated[world] and not terminated[world]),
                "cause": int(info["cause"][world]),
            }
        return observations, rewards, over, told

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_images(self) -> list[Any]:
        """Return a picture of each world."""
        return list(self.env.render() or ())

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the environment, for each of some worlds."""
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the environment, which is that of all worlds."""
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call a method of the environment once, and return its result for each of some worlds."""
        result = getattr(self.env, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return false for each of some worlds: nothing is wrapped."""
        return [False for _ in self._get_indices(indices)]
