"""Processes of an environment: each steps some of the worlds, on a GPU of its own."""

from collections.abc import Sequence
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple

from gymnasium.vector import AutoresetMode

from balloon_warp.envs.arrays import Output
from balloon_warp.envs.task import Task
from balloon_warp.envs.vector_env import BalloonVectorEnv
from balloon_warp.errors import InputError, WorkersLostError
from balloon_warp.solvers.choose import settled_solver
from balloon_warp.sweep.child import UNGUARDED, UNSENT, as_sent, end_children, start_child
from balloon_warp.warp_logging import quiet_warp


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
        settled = settled_solver(self.schedule, env.simulator.model, self.world_count)
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
