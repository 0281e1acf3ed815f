"""Many worlds of a task on several GPUs as one environment of Gymnasium."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import CloudpickleWrapper
from numpy.typing import NDArray

from balloon_warp.envs.arrays import Output, copy_actions, output_of
from balloon_warp.envs.processes import Part, Processes
from balloon_warp.envs.task import Task
from balloon_warp.envs.told import joined
from balloon_warp.envs.vector_env import (
    BalloonVectorEnv,
    Mode,
    Unpickled,
    require_choices,
    require_open,
    results_of,
    spaces_of,
)
from balloon_warp.errors import InputError
from balloon_warp.sweep.cluster import Cluster, worker_environments


class SpreadVectorEnv(Unpickled, VectorEnv[Any, Any, Any]):
    """A batch of worlds of a task, which step together on several GPUs, with a process for each.

    Episodes have the bits of a single process. Actions and results pass the host as NumPy's arrays. A policy that is to
    sit on each GPU is a function that `on_each` calls there. A script needs its main part under
    `if __name__ == "__main__":`, since each process imports it.

    Args:
        task: scene, actions, observations and rewards.
        num_envs: number of worlds.
        gpus: number of GPUs of this machine.
        workers: number of processes on this machine's CPU, instead.
        autoreset_mode: as of `BalloonVectorEnv`.
        output: "numpy" or "torch", the arrays that functions of `on_each` see.
        schedule: how the work is laid out, see `Simulator`.
        render_mode: "rgb_array", or nothing.

    Raises:
        InputError: a value cannot be, there are fewer GPUs, or the task cannot be sent to a process.
        WorkersLostError: a process ended.
    """

    def __init__(
        self,
        task: Task,
        num_envs: int = 1,
        *,
        gpus: int | None = None,
        workers: int | None = None,
        autoreset_mode: Mode = AutoresetMode.NEXT_STEP,
        output: Output = "numpy",
        schedule: str = "auto",
        render_mode: str | None = None,
    ):
        require_choices(num_envs, autoreset_mode, render_mode)
        if render_mode == "human":
            raise InputError('render_mode: worlds in processes of their own have no page; expected "rgb_array" or None')
        output_of(output)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        own = {"render_modes": ["rgb_array"], "autoreset_mode": self.autoreset_mode}
        self.metadata = {**BalloonVectorEnv.metadata, **own}
        self.num_envs, self.task, self.render_mode = int(num_envs), task, render_mode
        spaces = spaces_of(task, self.num_envs)
        (self.single_observation_space, self.single_action_space), (self.observation_space, self.action_space) = spaces
        cluster = Cluster(gpus=gpus, workers=workers)
        environments = worker_environments(cluster)[: self.num_envs]
        limits = np.linspace(0, self.num_envs, len(environments) + 1).round().astype(int)
        self.parts = [range(int(begin), int(end)) for begin, end in pairwise(limits)]
        """Numbers of the worlds of each process"""
        self._actions = wp.zeros((self.num_envs, task.actions), dtype=wp.float32, device="cpu")
        device = str(cluster.device(None))
        of_all = (self.num_envs, device, self.autoreset_mode, output, schedule, render_mode)
        parts = [Part(task, worlds, *of_all) for worlds in self.parts]
        self._processes = Processes(parts, environments, cluster.option)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin all worlds anew, or those of `options={"reset_mask": mask}`, as of `BalloonVectorEnv`.

        Raises:
            InputError: the mask has another length.
        """
        require_open(self)
        super().reset(seed=seed)
        told_seed = int(self.np_random_seed or 0) if seed is not None or self._np_random_seed is None else None
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs)))
        if mask.shape != (self.num_envs,):
            raise InputError(f"reset: expected a value for each world, of shape ({self.num_envs},) (got {mask.shape})")
        told = [(told_seed, {"reset_mask": each}) for each in self._split(mask)]
        return np.concatenate(self._processes.ask("reset", told)), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Advance all worlds by the frames of a step.

        Raises:
            InputError: the actions have another shape, or are no numbers.
        """
        require_open(self)
        copy_actions(self._actions, actions)
        parts = [(each,) for each in self._split(np.asarray(self._actions.numpy()))]
        return results_of(joined(self._processes.ask("step", parts)), self.autoreset_mode)

    def on_each(self, function: Callable[..., Any], *arguments: Any) -> list[Any]:
        """Call a function in each process at once, and return the results in the order of the worlds.

        Use it to let a policy sit on each GPU: neither actions nor observations leave it then.

        Args:
            function: of the process's own `BalloonVectorEnv`, and of `arguments`; its result is pickled.

        Raises:
            WorkersLostError: a process ended.
            Exception: the first that the function raised; all processes are ended then.
        """
        require_open(self)
        told = (CloudpickleWrapper(function), arguments)
        return self._processes.ask("call", [told] * len(self.parts))

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture of each world, shape (height, width, 3), uint8."""
        require_open(self)
        if self.render_mode is None:
            return None
        return tuple(picture for part in self._processes.ask("render", [()] * len(self.parts)) for picture in part)

    def close_extras(self, **_: Any) -> None:
        """End the processes."""
        if hasattr(self, "_processes"):
            self._processes.end()

    def _split(self, rows: NDArray[Any]) -> Sequence[NDArray[Any]]:
        return [rows[worlds.start : worlds.stop] for worlds in self.parts]
