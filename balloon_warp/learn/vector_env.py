"""Many worlds of a task as one environment of Gymnasium: on one device, on several GPUs, or for learners with torch."""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import numpy as np
import warp as wp
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import CloudpickleWrapper, batch_space
from numpy.typing import NDArray

from balloon_warp.errors import InputError, MissingExtraError, WorkersLostError
from balloon_warp.farm.cluster import Cluster
from balloon_warp.farm.workers import UNGUARDED, UNSENT, as_sent, end_children, start_child, worker_environments
from balloon_warp.kernels.steering import bound_observations, finish_step, restart_steps, take_actions
from balloon_warp.learn.tasks import Task
from balloon_warp.simulator import Simulator
from balloon_warp.solvers import resolved_solver
from balloon_warp.steering.controls import copy_given
from balloon_warp.studio.page.view import look_on
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import launch

if TYPE_CHECKING:
    from balloon_warp.studio.page.page import Onlooker


class StepResults(NamedTuple):
    """Results of a step, arrays of NumPy or torch with a row a world."""

    observations: Any
    """Shape (world_count, observations), float32"""
    final_observations: Any
    """Observations before worlds have begun anew in the same step"""
    rewards: Any
    """Shape (world_count,), float32"""
    terminated: Any
    """Shape (world_count,), bool"""
    truncated: Any
    causes: Any
    """Why a world has ended other than by its task, int32"""


FLAGS = ("terminated", "truncated")
"""Numbers that become truth values in the results"""
INTEGERS = (*FLAGS, "causes")


@dataclass(frozen=True)
class Layout:
    """Layout of the arrays in a block of 4-byte words."""

    world_count: int
    observations: int
    """Number of observations of a world"""

    @property
    def _shapes(self) -> dict[str, tuple[int, ...]]:
        rows = (self.world_count, self.observations)
        return {name: rows if "observations" in name else rows[:1] for name in StepResults._fields}

    @property
    def size(self) -> int:
        """Number of words."""
        return sum(int(np.prod(shape)) for shape in self._shapes.values())

    def split(self, block: Any, float32: Any) -> dict[str, Any]:
        """Return the arrays of a block of int32, which share its memory.

        Args:
            block: array of Warp, NumPy or torch.
            float32: data type of that library.
        """
        arrays, begin = {}, 0
        for name, shape in self._shapes.items():
            part = block[begin : (begin := begin + int(np.prod(shape)))]
            arrays[name] = (part if name in INTEGERS else part.view(float32)).reshape(shape)
        return arrays

    def told(self, block: Any, float32: Any) -> StepResults:
        """Return the results in a block, from the arrays of `split`."""
        arrays = self.split(block, float32)
        return StepResults(**{name: array != 0 if name in FLAGS else array for name, array in arrays.items()})


def joined(parts: Sequence[StepResults]) -> StepResults:
    """Return the results of all worlds, from NumPy's arrays of parts in their order."""
    return StepResults(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


@dataclass(frozen=True)
class Buffers:
    """Arrays with a row a world. Those of the results lie in a single block, which is copied at once."""

    block: wp.array
    """Memory of the results, laid out by `Layout`, int32"""
    given: wp.array
    """Actions as they are given, shape (world_count, actions)"""
    actions: wp.array
    """Actions that are taken, shape (world_count, actions)"""
    observations: wp.array
    final_observations: wp.array
    """Observations before worlds have begun anew in the same step"""
    rewards: wp.array
    terminated: wp.array
    truncated: wp.array
    causes: wp.array
    """Why a world has ended other than by its task, see `CAUSES`"""
    over: wp.array
    """1 of worlds whose episode is over"""
    begun: wp.array
    """1 of worlds that have begun anew in this step"""
    steps: wp.array
    """Steps since the episode began"""
    scratch: wp.array
    """Rewards that nobody is told"""
    ignored: wp.array
    """Ends that nobody is told"""

    @classmethod
    def of(cls, task: Task, world_count: int, device: Any) -> Self:
        """Allocate the memory of a task."""

        def zeros(dtype: Any, *shape: int) -> wp.array:
            return wp.zeros((world_count, *shape), dtype=dtype, device=device)

        layout = Layout(world_count, task.observations)
        block = wp.zeros(layout.size, dtype=wp.int32, device=device)
        actions = {name: zeros(wp.float32, task.actions) for name in ("given", "actions")}
        flags = {name: zeros(wp.int32) for name in ("over", "begun", "steps", "ignored")}
        told = layout.split(block, wp.float32)
        return cls(block=block, scratch=zeros(wp.float32), **actions, **flags, **told)


Output = Literal["numpy", "torch"]


class NumpyOutput:
    """Copies the results of a step to the host, at once and through pinned memory."""

    def __init__(self, layout: Layout, device: wp.Device):
        self._layout, self._device = layout, device
        self._host = wp.empty(layout.size, dtype=wp.int32, device="cpu", pinned=device.is_cuda)

    def __call__(self, block: wp.array) -> StepResults:
        """Return the results in a block."""
        wp.copy(self._host, block)
        if self._device.is_cuda:
            wp.synchronize_stream(self._device.stream)
        return self._layout.told(np.array(self._host.numpy()), np.float32)


class TorchOutput:
    """Copies the results of a step into torch's memory of the same device; the host does not wait."""

    def __init__(self, layout: Layout, device: wp.Device):
        self._layout = layout

    def __call__(self, block: wp.array) -> StepResults:
        """Return the results in a block."""
        import torch  # pyright: ignore[reportMissingImports]

        return self._layout.told(wp.to_torch(block).clone(), torch.float32)


def output_of(output: Output) -> type[NumpyOutput] | type[TorchOutput]:
    """Return the class that copies the results of a step into arrays of NumPy or torch.

    Raises:
        InputError: there is no such kind.
        MissingExtraError: torch is not installed.
    """
    if output not in ("numpy", "torch"):
        raise InputError(f'output: must be "numpy" or "torch" (got {output!r})')
    if output == "torch" and not find_spec("torch"):
        raise MissingExtraError('output = "torch" needs torch: pip install torch')
    return NumpyOutput if output == "numpy" else TorchOutput


def copy_actions(target: wp.array, given: Any) -> None:
    """Copy actions into an array of the device.

    Raises:
        InputError: they have another shape, or are no numbers.
    """
    if isinstance(given, np.ndarray) and given.dtype.kind not in "fiub":
        raise InputError(f"actions: must be numbers (got an array of {given.dtype})")
    shape = tuple(np.shape(given) if not hasattr(given, "shape") else given.shape)
    if shape != tuple(target.shape):
        raise InputError(f"actions: expected shape {tuple(target.shape)} (got {shape})")
    copy_given(target, given, "actions")


CAUSES = ("", "an action is not finite", "a control is not finite or out of bounds", "the simulation blew up")
"""Values of `info["cause"]` for a world, by the numbers of kernels"""
RENDER_MODES = ("human", "rgb_array")
Mode = AutoresetMode | Literal["NextStep", "SameStep", "Disabled"]


class Unpickled:
    """An environment that cannot be copied or pickled: its state is on a device, or in processes."""

    def __reduce__(self) -> Any:
        raise InputError(
            "an environment cannot be copied or pickled; expected a function that makes it, such as "
            'lambda: make("Target"), or what env.simulator.save() returns'
        )


class BalloonVectorEnv(Unpickled, VectorEnv[Any, Any, Any]):
    """A batch of worlds of a task, which step together on one device.

    `info` has `cause`, a number a world: 0 if all is well, 1 if an action was not finite, 2 if a control was not finite
    or out of its bounds, 3 if the simulation blew up. Such a world ends, and the others go on.

    Args:
        task: scene, actions, observations and rewards.
        num_envs: number of worlds.
        device: a Warp device such as "cpu" or "cuda:0"; if missing, the GPU or else the CPU.
        autoreset_mode: when a world that is over begins anew: in the next step, in the same step, or when `reset` is
            told so, `options={"reset_mask": mask}`.
        output: "numpy", or "torch" for tensors on the device, which do not pass the host.
        schedule: how the work is laid out, see `Simulator`.
        render_mode: "rgb_array", "human" for a page in the browser that shows the first world, or nothing.
        first_world: number of the first world, by which episodes are drawn, where another process has those before it.

    Raises:
        InputError: a value cannot be.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as Gymnasium has it
        "render_modes": list(RENDER_MODES),
        "render_fps": 60,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        task: Task,
        num_envs: int = 1,
        *,
        device: str | None = None,
        autoreset_mode: Mode = AutoresetMode.NEXT_STEP,
        output: Output = "numpy",
        schedule: str = "auto",
        render_mode: str | None = None,
        first_world: int = 0,
    ):
        require_choices(num_envs, autoreset_mode, render_mode)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": self.autoreset_mode}
        self.num_envs, self.task, self.render_mode = int(num_envs), task, render_mode
        told_as = output_of(output)
        self.simulator = Simulator(task.scene(), device, self.num_envs, schedule=schedule, laws=task.laws())
        self.simulator.starts.first_world = first_world
        self.onlooker: Onlooker | None = None
        """Page of render mode "human", from the first reset on"""
        task.begin(self.simulator)
        self._first_bad = self.simulator.observations["first_bad"]
        device_used = self.simulator.model.device
        self._buffers = Buffers.of(task, self.num_envs, device_used)
        self._limits = wp.array(limits_of(task), dtype=wp.float32, device=device_used)
        self._out = told_as(Layout(self.num_envs, task.observations), device_used)
        spaces = spaces_of(task, self.num_envs)
        (self.single_observation_space, self.single_action_space), (self.observation_space, self.action_space) = spaces

    @property
    def episode_steps(self) -> wp.array:
        """Steps of each world since its episode began, shape (num_envs,), int32, on the device."""
        return self._buffers.steps

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin all worlds anew, or those of `options={"reset_mask": mask}`.

        Draws follow from the seed, the number of the world and its episode. Without a seed episodes go on.

        Raises:
            InputError: the mask has another length, or the environment is closed.
        """
        require_open(self)
        super().reset(seed=seed)
        starts, buffers = self.simulator.starts, self._buffers
        if seed is not None or self._np_random_seed is None:
            starts.seed = int(self.np_random_seed or 0)
            starts.episodes.zero_()
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs))
        self.simulator.reset(mask)
        wp.copy(buffers.begun, starts.mask)
        self._restart(buffers.begun)
        if self.render_mode == "human":
            self.onlooker = self.onlooker or look_on(self.simulator)
            self.onlooker.show()
        return self._out(buffers.block).observations, {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Advance all worlds by the frames of a step.

        Raises:
            InputError: the actions have another shape, or are no numbers, or the environment is closed.
        """
        return results_of(self.advance(actions), self.autoreset_mode)

    def advance(self, actions: Any) -> StepResults:
        """Advance all worlds by the frames of a step. The host waits once, for the results in the end.

        Raises:
            InputError: as `step`.
        """
        require_open(self)
        buffers, device = self._buffers, self.simulator.model.device
        copy_actions(buffers.given, actions)
        launch(take_actions, self.num_envs, [buffers.given], [buffers.actions, buffers.causes], device=device)
        self.task.act(buffers.actions)
        for _ in range(self.task.frames):
            self.simulator.advance()
        buffers.begun.zero_()
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            wp.copy(buffers.begun, buffers.over)
            self.simulator.reset(buffers.begun)
        self._judge(buffers.rewards)
        self._finish()
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            wp.copy(buffers.final_observations, buffers.observations)
            self._begin_over()
        if self.onlooker:
            self.onlooker.show(self.task.frames * self.simulator.model.frame_seconds)
        return self._out(buffers.block)

    def _judge(self, rewards: wp.array) -> None:
        buffers = self._buffers
        flags = buffers.terminated if rewards is buffers.rewards else buffers.ignored
        flags.zero_()
        self.task.judge(buffers.observations, rewards, flags)

    def _finish(self) -> None:
        buffers, simulator = self._buffers, self.simulator
        launch(
            finish_step,
            self.num_envs,
            [simulator.controls.faults, self._first_bad, self.task.most_steps, self._limits, buffers.begun],
            [
                *(buffers.steps, buffers.causes, buffers.observations, buffers.rewards),
                *(buffers.terminated, buffers.truncated, buffers.over),
            ],
            device=simulator.model.device,
        )

    def _begin_over(self) -> None:
        """Reset the worlds whose episode is over, and observe them again."""
        self.simulator.reset(self._buffers.over)
        self._restart(self._buffers.over)

    def _restart(self, begun: wp.array) -> None:
        """Count the steps of worlds that have begun anew, and observe all."""
        buffers = self._buffers
        told = [buffers.steps, buffers.over]
        device = self.simulator.model.device
        launch(restart_steps, self.num_envs, [begun], told, device=device)
        self._judge(buffers.scratch)
        launch(bound_observations, self.num_envs, [self._limits], [buffers.observations], device=device)

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture of each world, shape (height, width, 3), uint8; the page draws itself in each step."""
        require_open(self)
        if self.render_mode != "rgb_array":
            return None
        from PIL import Image

        pictures = (self.simulator.picture(world, (320, 180), samples=1) for world in range(self.num_envs))
        return tuple(np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")) for picture in pictures)

    def close_extras(self, **_: Any) -> None:
        """End the page."""
        onlooker: Onlooker | None = getattr(self, "onlooker", None)  # none where it could not be made
        if onlooker:
            onlooker.stop()


def require_open(env: VectorEnv[Any, Any, Any]) -> None:
    """Make sure that an environment was not closed.

    Raises:
        InputError: it was.
    """
    if env.closed:
        raise InputError("the environment is closed; expected reset, step and render before close()")


def spaces_of(task: Task, num_envs: int) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """Return the spaces of observations and actions of one world, and of all."""
    limits = limits_of(task)
    seen, done = Box(-limits, limits, dtype=np.float32), Box(-1.0, 1.0, (task.actions,), np.float32)
    return (seen, done), (batch_space(seen, num_envs), batch_space(done, num_envs))


def limits_of(task: Task) -> NDArray[np.float32]:
    """Return the largest magnitude of each of a task's observations.

    Raises:
        InputError: they are other than one for all or one for each, above 0.
    """
    limits = np.asarray(task.observation_limits, dtype=np.float32)
    if limits.shape not in ((), (task.observations,)) or not (limits > 0.0).all():
        raise InputError(
            f"observation_limits: expected a number above 0, or {task.observations} of them (got {limits.tolist()})"
        )
    return np.broadcast_to(limits, (task.observations,)).copy()


def results_of(told: StepResults, mode: AutoresetMode) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
    """Return the results of a step in Gymnasium's form."""
    info: dict[str, Any] = {"cause": told.causes}
    if mode is AutoresetMode.SAME_STEP:
        over = told.terminated | told.truncated
        info |= {"final_obs": told.final_observations, "_final_obs": over}
        info |= {"final_info": {"cause": told.causes}, "_final_info": over}
    return told.observations, told.rewards, told.terminated, told.truncated, info


def require_choices(num_envs: Any, mode: Any, render_mode: Any) -> None:
    """Make sure that an environment can be made of these.

    Raises:
        InputError: it cannot.
    """
    if isinstance(num_envs, bool) or not isinstance(num_envs, int | np.integer) or num_envs < 1:
        raise InputError(f"num_envs: must be a whole number of at least 1 (got {num_envs!r})")
    modes = [mode.value for mode in AutoresetMode]
    if mode not in (*AutoresetMode, *modes):
        raise InputError(f"autoreset_mode: must be one of {', '.join(modes)} (got {mode!r})")
    if render_mode not in (None, *RENDER_MODES):
        raise InputError(f'render_mode: must be "human", "rgb_array" or None (got {render_mode!r})')


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
