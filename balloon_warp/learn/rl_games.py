"""Many worlds of a task as rl_games takes them, once `register` has named them.

    worlds = {"output": "torch", "autoreset_mode": "SameStep"}
    rl_games.register("balloon", lambda count: make_vec("Target", count, **worlds))

In a configuration `env_name` is that name, and `num_actors` the number of worlds.
"""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from balloon_warp.errors import MissingExtraError
from balloon_warp.learn.vector_env import BalloonVectorEnv, TorchWorlds

if not find_spec("rl_games"):
    raise MissingExtraError("balloon_warp.learn.rl_games needs rl_games: pip install rl-games")

from rl_games.common import env_configurations, vecenv  # pyright: ignore[reportMissingImports]
from rl_games.common.ivecenv import IVecEnv  # pyright: ignore[reportMissingImports]


class RlGamesEnv(IVecEnv):
    """Worlds of an environment, for rl_games.

    Args:
        env: of `make_vec(..., output="torch", autoreset_mode="SameStep")`.

    Raises:
        InputError: the environment tells NumPy's arrays, or resets worlds otherwise.
    """

    def __init__(self, env: BalloonVectorEnv):
        self.worlds = TorchWorlds(env, "rl_games")

    def reset(self) -> Any:
        """Reset all worlds, and return the observations."""
        return self.worlds.reset()

    def step(self, actions: Any) -> tuple[Any, Any, Any, dict[str, Any]]:
        """Advance all worlds by the frames of a step."""
        return self.worlds.step(actions)

    def get_env_info(self) -> dict[str, Any]:
        """Return the spaces of one world."""
        env = self.worlds.env
        return {"observation_space": env.single_observation_space, "action_space": env.single_action_space}

    def close(self) -> None:
        """Close the environment."""
        self.worlds.env.close()


def register(name: str, make: Callable[[int], BalloonVectorEnv]) -> None:
    """Tell rl_games of an environment, for `env_name: NAME` of its configurations.

    Args:
        make: of the number of worlds, `num_actors` there.
    """
    vecenv.register(name, lambda _, count, **options: RlGamesEnv(make(count)))
    env_configurations.register(name, {"vecenv_type": name, "env_creator": lambda **options: make(1)})
