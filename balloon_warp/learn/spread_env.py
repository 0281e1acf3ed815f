"""Many worlds of a task on several GPUs as one environment of Gymnasium."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import CloudpickleWrapper
from numpy.typing import NDArray

from balloon_warp.errors import InputError, WorkersLostError
from balloon_warp.farm.cluster import Cluster
from balloon_warp.farm.local_workers import UNGUARDED, UNSENT, as_sent, end_children, start_child
from balloon_warp.farm.workers import worker_environments
from balloon_warp.learn.task import Task
from balloon_warp.learn.vector_env import (
    BalloonVectorEnv,
    Mode,
    Output,
    Unpickled,
    copy_actions,
    joined,
    output_of,
    require_choices,
    require_open,
    results_of,
    spaces_of,
)
from balloon_warp.solvers import resolved_solver
from balloon_warp.system.warp_setup import quiet_warp


class Part(NamedTuple):
    """Worlds of a process, and the options of their environment."""

    task: Task
    worlds: range
    """Numbers of its worlds"""
    world_count: int
    """Number of worlds of all processes, by which an automatic schedule is chosen"""
    device: str
    mode: AutoresetMode
    output: Output
    schedule: str
    render_mode: str | None

    def env(self) -> BalloonVectorEnv:
        """Make the environment of these worlds, with the schedule that all worlds in one process would have."""
        env = self._env(self.schedule)
        settled = resolved_solver(self.schedule, env.simulator.model, self.world_count)
        return env if settled == env.simulator.schedule.name else self._env(settled)

    def _env(self, schedule: str) -> BalloonVectorEnv:
        return BalloonVectorEnv(
            self.task,
            len(self.worlds),
            device=self.device,
            autoreset_mode=self.mode,
            output=self.output,
            schedule=schedule,
            render_mode=self.render_mode,
            first_world=self.worlds.start,
        )


class Processes:
    """Processes that each step a part of the worlds, and answer in the order of the parts.

    They end with this object, and with the process that started them, however it ends. After a failure all are ended.

    Args:
        option: names them in errors, such as "gpus 4".

    Raises:
        InputError: the task cannot be sent to a process, or a part cannot be made.
        WorkersLostError: a process ended.
    """

    def __init__(self, parts: Sequence[Part], environments: Sequence[dict[str, str]], option: str):
        self._option = option
        self._workers: list[tuple[Any, Connection]] = []
        try:
            for part, environment in zip(parts, environments, strict=True):
                self._workers.append(start_child(_serve, environment, part))
            self._answers(f"ended as it started; {UNGUARDED}")
        except UNSENT as error:
            self.end()
            raise InputError(f"task: cannot be sent to a process: {error}") from None
        except BaseException:
            self.end()
            raise

    def ask(self, method: str, arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Call a method of `_Served` in each process, with arguments of its own, and return the answers.

        Raises:
            WorkersLostError: a process ended.
            Exception: of a process, raised again here.
        """
        if not self._workers:
            raise WorkersLostError(f"{self._option}: the processes have ended")
        try:
            for (_, connection), given in zip(self._workers, arguments, strict=True):
                connection.send((method, given))
            return self._answers("ended")
        except BrokenPipeError:
            self.end()
            raise WorkersLostError(f"{self._option}: a process ended") from None
        except BaseException:
            self.end()
            raise

    def _answers(self, ended: str) -> list[Any]:
        """Wait for the answers of all; the first failure ends the wait."""
        answers: dict[Connection, Any] = {}
        waiting = {connection: number for number, (_, connection) in enumerate(self._workers)}
        while waiting:
            for each in wait(list(waiting)):
                connection: Any = each
                number = waiting.pop(connection)
                try:
                    answer, failure = connection.recv()
                except (EOFError, ConnectionResetError):
                    raise WorkersLostError(f"{self._option}: process {number} {ended}") from None
                if failure is not None:
                    raise failure
                answers[connection] = answer
        return [answers[connection] for _, connection in self._workers]

    def end(self) -> None:
        """End all processes."""
        for _, connection in self._workers:
            connection.close()
        end_children(process for process, _ in self._workers)
        self._workers = []


class _Served:
    """Methods that a process calls when it is asked."""

    def __init__(self, env: BalloonVectorEnv):
        self._env = env

    def reset(self, seed: int | None, options: dict[str, Any]) -> Any:
        observations, _ = self._env.reset(seed=seed, options=options)
        return _on_host(observations)

    def step(self, actions: Any) -> Any:
        told = self._env.advance(actions)
        return told._replace(**{name: _on_host(array) for name, array in told._asdict().items()})

    def render(self) -> Any:
        return self._env.render()

    def call(self, function: Any, arguments: tuple[Any, ...]) -> Any:
        return function.fn(self._env, *arguments)


def _on_host(array: Any) -> Any:
    return array.cpu().numpy() if hasattr(array, "cpu") else array


def _serve(connection: Connection, part: Part) -> None:
    """Serve the requests of a connection until its other end is closed; runs in a process of its own."""
    quiet_warp()
    try:
        served = _Served(part.env())
        connection.send((None, None))
        while True:
            method, arguments = connection.recv()
            connection.send((getattr(served, method)(*arguments), None))
    except (EOFError, BrokenPipeError):
        return
    except Exception as failure:
        connection.send((None, as_sent(failure)))


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
