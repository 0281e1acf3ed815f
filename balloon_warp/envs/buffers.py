"""Memory of an environment on its device."""

from dataclasses import dataclass
from typing import Any, Self

import warp as wp

from balloon_warp.envs.task import Task
from balloon_warp.envs.told import Layout


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
