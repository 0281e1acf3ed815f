"""Memory of an environment on its device."""

from dataclasses import dataclass
from typing import Any, Self

import warp as wp

from balloon_warp.envs.task import Task


@dataclass(frozen=True)
class Buffers:
    """Arrays with a row a world."""

    actions: wp.array
    """Actions that are taken, shape (world_count, actions)"""
    observations: wp.array
    rewards: wp.array
    terminated: wp.array
    truncated: wp.array
    over: wp.array
    """1 of worlds whose episode is over"""
    begun: wp.array
    """1 of worlds that have begun anew in this step"""
    causes: wp.array
    """Why a world has ended other than by its task, see `CAUSES`"""
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

        flags = ("terminated", "truncated", "over", "begun", "causes", "steps", "ignored")
        return cls(
            actions=zeros(wp.float32, task.actions),
            observations=zeros(wp.float32, task.observations),
            rewards=zeros(wp.float32),
            scratch=zeros(wp.float32),
            **{name: zeros(wp.int32) for name in flags},
        )
