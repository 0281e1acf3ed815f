"""Worlds to the host, one at a time."""

from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.frame import Frame
from balloon_warp.kernels.laws.law import FAR
from balloon_warp.model import Model, State

MOST_RECORDED = 16
"""worlds whose reading is recorded on a GPU; more are read launch by launch"""
STATE = ("points", "velocities", "pressures", "gas_amounts", "sphere_positions", "sphere_velocities")
PARAMETERS = ("string_anchor", "ground_height", "water_level")


class FrameReader:
    """Copies worlds of a model to the host, one at a time."""

    def __init__(self, model: Model):
        self.model = model
        self._readers: dict[tuple[int, bool], WorldReader] = {}

    @cached_property
    def _forces(self) -> Any:
        """Of the first world that is read; the others share its memory."""
        from balloon_warp.schedules.readout import ForceReader  # loads, and compiles kernels, when first needed

        return ForceReader(self.model.of_world(0, copied=False), self.model)

    def read(self, state: State, number: int, world: int, net_forces: bool) -> Frame:
        """One world of a state at the frame of that number, with forces if they are wanted."""
        reader = self._readers.get((world, net_forces))
        if reader is None or reader.state is not state:
            model = self.model.of_world(world, copied=False)
            by_normals = any(balloon.inflation.kind == "normal_force" for balloon in model.scene.balloon)
            forces = self._forces.beside(model) if net_forces or by_normals else None
            reader = WorldReader(model, state, world, forces, net_forces)
            if len(self._readers) < MOST_RECORDED:
                self._readers[world, net_forces] = reader
        return reader.read(number)


class WorldReader:
    """Copies one world to the host.

    On a GPU that is recorded when it is first done again: one launch, and one wait, since each of so many small copies
    would cost more than what it copies.

    Args:
        model: of the world alone.
        state: of all worlds.
        forces: what finds the inflation's forces, or None if nothing does.
        net_forces: whether it finds those of all, too.
    """

    def __init__(self, model: Model, state: State, world: int, forces: Any, net_forces: bool):
        self.model, self.state = model, state
        self._own, self._forces = state.of_world(world), forces
        self._graph, self._times_read = None, 0
        sources = {name: getattr(self._own, name) for name in STATE}
        sources |= {name: model.parameters[name] for name in PARAMETERS}
        self._sources = {name: source for name, source in sources.items() if source.size}
        self._host = {name: self._like(source) for name, source in self._sources.items()}
        if forces:
            self._host["inflation_forces"] = self._like(self._own.points)
        if net_forces:
            self._host["net_forces"] = self._like(self._own.points)

    def read(self, number: int) -> Frame:
        """The frame of that number."""
        self._fetch()
        return Frame(
            number=number,
            time=number * self.model.frame_seconds,
            points=self._moving_along("points"),
            velocities=self._moving_along("velocities"),
            net_forces=self._of_balloons("net_forces"),
            inflation_forces=self._of_balloons("inflation_forces"),
            pressures=self._row("pressures", np.float32),
            gas_amounts=self._row("gas_amounts", np.float64),
            sphere_positions=self._rows("sphere_positions"),
            sphere_velocities=self._rows("sphere_velocities"),
            string_anchors=self._rows("string_anchor"),
            ground_height=self._height("ground_height"),
            water_level=self._height("water_level"),
            meshes=[shape.mesh for shape in self.model.shapes],
        )

    def _fetch(self) -> None:
        """All arrays to the host."""
        device = self.model.device
        self._times_read += 1
        if device.is_cuda and self._times_read == 2:
            with wp.ScopedDevice(device), wp.ScopedCapture(device) as capture:
                self._copy()
            self._graph = capture.graph
        if self._graph is not None:
            wp.capture_launch(self._graph)
        else:
            self._copy()
        if device.is_cuda:
            wp.synchronize_stream(device)

    def _copy(self) -> None:
        if self._forces:
            self._forces.refresh(self._own)
            if "net_forces" in self._host:
                wp.copy(self._host["net_forces"], self._forces.net_forces(self._own))
            wp.copy(self._host["inflation_forces"], self._forces.inflation_forces(self._own))
        for name, source in self._sources.items():
            wp.copy(self._host[name], source)

    def _like(self, source: wp.array) -> wp.array:
        """Memory of the host for an array."""
        return wp.empty(source.shape, dtype=source.dtype, device="cpu", pinned=self.model.device.is_cuda)

    def _row(self, name: str, dtype: Any) -> NDArray[Any]:
        """The world's row of what is on the host, for whoever is to keep it."""
        return np.array(self._host[name].numpy()[0] if name in self._host else np.zeros(0), dtype=dtype)

    def _rows(self, name: str) -> NDArray[np.float32]:
        """The same of vectors."""
        return self._row(name, np.float32).reshape(-1, 3)

    def _of_balloons(self, name: str) -> list[NDArray[np.float32]]:
        """The rows of particles, split by balloon; none if they are not read."""
        return np.split(self._rows(name), self.model.particle_offsets[1:-1]) if name in self._host else []

    def _moving_along(self, name: str) -> list[NDArray[np.float32]]:
        """The same, welded vertices with the rows of those that stand in for them."""
        stand_ins = (shape.mesh.stand_ins for shape in self.model.shapes)
        rows = self._of_balloons(name)
        return [own if others is None else own[others] for own, others in zip(rows, stand_ins, strict=True)]

    def _height(self, name: str) -> float:
        """Of a surface [m]; minus infinity where there is none."""
        height = float(self._row(name, np.float32)[()])
        return height if height > -FAR else -np.inf
