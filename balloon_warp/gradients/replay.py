"""Beginnings of a simulation's frames, from the trajectories and the device, or on the host by themselves.

Places and velocities with which a frame begins are those of the trajectories, where these have all frames. They stay on
the host. So a device keeps little of each frame, and there may be many. Where trajectories have fewer, or few are asked
for, the start states of some are kept on the host, and others are simulated again from there.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.device import pick_device
from balloon_warp.gradients.checkpoints import AllFrames, Beginnings, FewFrames
from balloon_warp.gradients.spans import KeptParameters
from balloon_warp.model.memory import usable_memory
from balloon_warp.schedules.backward import BackwardFrames
from balloon_warp.simulator import Simulator
from balloon_warp.warp_lock import lock_of

IN_TRACKS = ("points", "velocities")
"""Parts of a frame's beginning that the trajectories have"""


def beginnings_in_tracks(
    simulator: Simulator, backward: BackwardFrames, tracks: Mapping[str, NDArray[Any]]
) -> Beginnings:
    """Return the start states of all frames, most of which trajectories have."""

    def keep(frame: int) -> dict[str, Any]:
        with lock_of(simulator.model.device):
            little = backward.checkpoint(simulator.state, but=IN_TRACKS)
        return little | {name: tracks[name][:, frame] for name in IN_TRACKS}

    return AllFrames(keep)


def beginnings_on_host(
    simulator: Simulator, backward: BackwardFrames, parameters: KeptParameters, frames: int, most: int
) -> Beginnings:
    """Return the start states of some frames, at most so many at a time; the simulator simulates others again."""
    device = simulator.model.device

    def keep(frame: int) -> dict[str, Any]:
        with lock_of(device):
            return {name: array.numpy() for name, array in backward.checkpoint(simulator.state).items()}

    def set_parameters(frame: int) -> None:
        if values := parameters.of_span(parameters.span_of(frame)):
            simulator.set_parameters(values)

    def go_back(frame: int, beginning: Mapping[str, Any]) -> None:
        set_parameters(frame)
        with lock_of(device):
            for name, array in beginning.items():
                getattr(simulator.state, name).assign(array)
        simulator.frame_number = frame

    def advance(frame: int) -> None:
        if parameters.span_of(frame) != parameters.span_of(frame - 1):
            set_parameters(frame)
        simulator.advance()

    return FewFrames(frames, most, keep, go_back, advance)


def checkpoints_that_fit(simulator: Simulator, backward: BackwardFrames, frames: int, taken: int) -> int:
    """Return how many frames' beginnings the host has room for, up to all, and at least 1.

    Args:
        taken: memory of the host that something else wants.
    """
    arrays = [getattr(simulator.state, name) for name in backward.kept_names]
    each = sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in arrays)
    return int(np.clip((usable_memory(pick_device("cpu")) - taken) // each, 1, frames))
