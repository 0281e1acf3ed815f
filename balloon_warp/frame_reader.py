"""Worlds to the host, one at a time."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.model import Model, State, copy_of, overwrite
from balloon_warp.reading import HostBuffer, Reading, Recorded

MOST_RECORDED = 16
"""Largest number of worlds whose reading is recorded on a GPU; more are read launch by launch"""
STATE = (
    *("points", "velocities", "pressures", "gas_amounts", "thrusts"),
    *("sphere_positions", "sphere_velocities", "torn"),
    *("contact_forces", "contact_torques", "contact_areas", "contact_pressures", "contact_places"),
)
BODIES = ("body_positions", "body_turns")
PARAMETERS = ("string_anchor", "string_length", "obstacle_position", "ground_height", "water_level")


class FrameReader:
    """Copies worlds of a model to the host, one at a time."""

    def __init__(self, model: Model):
        self.model = model
        self._readers: dict[tuple[int, bool], WorldReader] = {}

    @cached_property
    def _stream(self) -> wp.Stream | None:
        return wp.Stream(self.model.device) if self.model.device.is_cuda else None

    @cached_property
    def _forces(self) -> Any:
        """Force arrays of the first world that is read; the others share its memory."""
        from balloon_warp.schedules.readout import ForceReader  # loads, and compiles kernels, when first needed

        return ForceReader(self.model.of_world(0, copied=False), self.model)

    def begin(self, state: State, number: int, world: int, net_forces: bool, buffer: int = 0) -> Reading:
        """Begin to read one world of a state at the frame of that number; on a GPU it is under way then.

        Forces are read if they are wanted.

        Args:
            buffer: of the host, 0 or 1: two readings may be under way.
        """
        reader = self._readers.get((world, net_forces))
        if reader is None or reader.state is not state:
            model = self.model.of_world(world, copied=False)
            by_normals = any(balloon.inflation.kind == "normal_force" for balloon in model.scene.balloon)
            forces = self._forces.beside(model) if net_forces or by_normals else None
            reader = WorldReader(model, state, world, forces, net_forces, self._stream)
            if len(self._readers) < MOST_RECORDED:
                self._readers[world, net_forces] = reader
        return reader.begin(number, buffer)


class WorldReader:
    """Copies one world to the host.

    On a GPU it takes a copy there first; a stream of its own goes on with that, while the next frame is simulated.

    Args:
        model: of the world alone.
        state: of all worlds.
        forces: finder of the inflation's forces, or None if they are not read.
        net_forces: whether it finds those of all, too.
        stream: of a GPU; None on a CPU.
    """

    def __init__(self, model: Model, state: State, world: int, forces: Any, net_forces: bool, stream: wp.Stream | None):
        self.model, self.state = model, state
        self._forces, self._stream = forces, stream
        self._here, self._own, self._first_bad = state.of_world(world), state.of_world(world), state.first_bad
        if stream:
            self._own, self._first_bad = copy_of(self._here), wp.clone(state.first_bad)
        self._take_copy = Recorded(self._take, model.device.stream if stream else None)
        sources = {name: getattr(self._own, name) for name in (*STATE, *BODIES)}
        sources |= {name: model.parameters[name] for name in PARAMETERS}
        sources["first_bad"] = self._first_bad  # for all worlds, as a reader of one reads them all
        self._sources = {name: source for name, source in sources.items() if source.size}
        self._shown = {"inflation_forces": self._own.points} if forces else {}
        if net_forces:
            self._shown["net_forces"] = self._own.points
        self._obstacle_motion = np.asarray(model.obstacle_motion.numpy(), dtype=np.float32)
        self._buffers: dict[int, HostBuffer] = {}
        self._last: HostBuffer | None = None

    def begin(self, number: int, buffer: int) -> Reading:
        """Begin to read the frame of that number into that buffer."""
        if buffer not in self._buffers:
            self._buffers[buffer] = HostBuffer({**self._sources, **self._shown}, self._copy, self._stream)
        if self._stream:
            self._hand_over(self._stream)
        self._last = self._buffers[buffer]
        self._last.fill()
        ages = self.model.ages
        since = number if ages is None else int(np.asarray(ages.numpy())[0])
        return Reading(self.model, self._last, number, obstacle_motion=self._obstacle_motion, since=since)

    def _hand_over(self, reading: wp.Stream) -> None:
        """Hand the current state of the simulation to the reading stream, once the last copy is read."""
        simulating = self.model.device.stream
        if self._last and self._last.filled:
            simulating.wait_event(self._last.filled)
        self._take_copy()
        reading.wait_event(simulating.record_event())

    def _take(self) -> None:
        overwrite(self._own, self._here)
        wp.copy(self._first_bad, self.state.first_bad)

    def _copy(self, host: Mapping[str, wp.array]) -> None:
        """Copy all arrays to the host."""
        if self._forces:
            self._forces.refresh(self._own)
            if "net_forces" in host:
                wp.copy(host["net_forces"], self._forces.net_forces(self._own))
            wp.copy(host["inflation_forces"], self._forces.inflation_forces(self._own))
        for name, source in self._sources.items():
            wp.copy(host[name], source)
