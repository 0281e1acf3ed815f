"""Base class of tasks: a scene, actions on it, observations and rewards."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.laws import Law
from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator


class Task(ABC):
    """A task of an environment. Copy one of this folder, and change it.

    Its kernels have a thread a world. They run on the device of the simulator, and nothing passes the host.
    """

    actions: ClassVar[int]
    """Number of actions, each from -1 to 1"""
    observations: ClassVar[int]
    """Number of observations"""
    observation_limits: ClassVar[float | tuple[float, ...]] = float("inf")
    """Largest magnitude of the observations, one for all or one for each, to which they are clipped"""
    most_steps: int
    """Number of steps after which an episode is truncated"""
    frames: ClassVar[int] = 1
    """Number of frames in a step"""

    @abstractmethod
    def scene(self) -> Scene:
        """Return the scene of every world."""

    def laws(self) -> Sequence[Law]:
        """Return laws of the task's own."""
        return ()

    @abstractmethod
    def begin(self, simulator: Simulator) -> None:
        """Open the controls and observations that the task needs, and the random values of each episode."""

    @abstractmethod
    def act(self, actions: wp.array) -> None:
        """Write controls, by actions of shape (world_count, actions), float32."""

    @abstractmethod
    def judge(self, observations: wp.array, rewards: wp.array, terminated: wp.array) -> None:
        """Write observations, shape (world_count, observations), rewards, and 1 where an episode has ended."""

    @staticmethod
    @abstractmethod
    def policy(observations: NDArray[Any]) -> NDArray[Any]:
        """Return the actions of a simple policy that is known to work, from observations."""
