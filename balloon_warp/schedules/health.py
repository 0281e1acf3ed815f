"""End of a frame: counting it, and checking every particle and sphere, on the device."""

from typing import Any

import numpy as np
import warp as wp

from balloon_warp.kernels.frames.around import end_frame
from balloon_warp.kernels.frames.starting import count_ages
from balloon_warp.kernels.measure.health import HealthTable
from balloon_warp.kernels.measure.locking import note_overstretched
from balloon_warp.kernels.measure.pressed import note_pressed
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.model.gas import pressure_bounds
from balloon_warp.model.most_pressure import ALL
from balloon_warp.schedules.particles import particle_table

MOST_SPAN = 1.0e5
"""Largest distance between two particles of a balloon over its initial size: float32 then resolves a hundredth of the
size, and no spring's length any more"""
FARTHEST = 1.0e7
"""Largest distance from the origin over the size of the largest thing in the world, which is then float32's resolution.
From rest, a meter-sized thing gets there by falling freely for 24 minutes."""
LEAST_SIZE = 1.0
"""Least size of that largest thing [m]: small balloons may fall or rise as long as large ones"""
LARGEST_ROOT = 1.0e19
"""Largest number whose square is a float32"""


class HealthCheck:
    """Finds the worlds that left the finite numbers, or whose particles or spheres are where they cannot be.

    It reads the points that the frame has just written, once, and nothing else that grows with the number of worlds: no
    spring's length, no velocity. A velocity that is not finite makes a place that is not, a substep later; so do gas
    and pressure. The host checks outputs once more: see `Frame.is_finite`.

    Args:
        model: the simulated model.
        threads: that share a world; as many as suit the device, when missing.
        particles: whether it looks at particles, or others have.
    """

    def __init__(self, model: Model, threads: int | None = None, particles: bool = True):
        if threads is None:
            threads = 1 if model.device.is_cpu or not particles else model.particle_count
        self._shape = (model.world_count, threads)
        self._device = model.device
        count = model.particle_count if particles else 0
        self._inputs = [particle_table(model), health_table(model), threads, count]
        self._model, self._locking = model, _locking_triangles(model)
        self._pressure_bounds = _pressure_bounds(model)

    def look(self, state: State) -> None:
        """Lower `state.first_bad` of each world to its first bad particle or sphere."""
        self._launch(state, 0)

    def end_frame(self, state: State) -> None:
        """Count the frame, and look at its results."""
        self._launch(state, 1)
        model, parameters = self._model, self._model.parameters
        if model.ages is not None:
            launch(count_ages, model.world_count, [], [model.ages], device=self._device)
        if self._pressure_bounds is not None:
            launch(
                note_pressed,
                (model.world_count, model.balloon_count),
                inputs=[
                    *(self._pressure_bounds, model.step_seconds, parameters["mass"]),
                    *(state.frame, state.pressures),
                ],
                outputs=[state.pressed],
                device=self._device,
            )
        if self._locking:
            launch(
                note_overstretched,
                (model.world_count, len(self._locking[0])),
                inputs=[
                    *(*self._locking, model.membrane_corners, model.membrane_rests, model.particle_balloon),
                    *(parameters["gent_limit"], parameters["most_stretch"], parameters["wrinkling"]),
                    *(state.frame, state.points, state.torn),
                ],
                outputs=[state.overstretched],
                device=self._device,
            )

    def _launch(self, state: State, frames: int) -> None:
        launch(
            end_frame,
            self._shape,
            inputs=[*self._inputs, frames, state.points, state.sphere_positions],
            outputs=[state.frame, state.first_bad],
            device=self._device,
        )


def _pressure_bounds(model: Model) -> wp.array | None:
    """Return the bounds of the pressures of gas; None where nothing has any."""
    bounds = pressure_bounds(model.scene, model.shapes)
    return wp.array(bounds, dtype=float, device=model.device) if min(bounds) < ALL else None


def _locking_triangles(model: Model) -> tuple[wp.array, wp.array] | None:
    """Return the triangles of rubber that locks, and the face of every triangle; None where there are none."""
    locks = np.array([balloon.material.law == "gent" for balloon in model.scene.balloon])
    if not locks.any():
        return None
    firsts = np.asarray(model.membrane_corners.numpy(), dtype=np.int64).reshape(-1, 3)[:, 0]
    balloons = np.asarray(model.particle_balloon.numpy(), dtype=np.int64)[firsts]
    triangles = wp.array(np.flatnonzero(locks[balloons]), dtype=wp.int32, device=model.device)
    return triangles, wp.array(model.triangle_faces, dtype=wp.int32, device=model.device)


def health_table(model: Model) -> Any:
    """Return the limits on positions of particles and spheres."""
    origins, partners, sizes, farthest = [], [], [LEAST_SIZE], [0.0]
    for shape, first in zip(model.shapes, model.particle_offsets, strict=False):
        corners = shape.mesh.face_vertex_indices
        origins.append(first + int(corners[0]))
        partners.append(first + int(corners[np.argmax(corners != corners[0])]))
        used = shape.mesh.points[corners]
        sizes.append(float(np.ptp(used, axis=0).max()))
        farthest.append(float(np.abs(used).max()))
    spheres = model.parameters["initial_sphere_positions"].numpy()
    reach = min(FARTHEST * max(sizes) + max([*farthest, float(np.abs(spheres).max(initial=0.0))]), LARGEST_ROOT)
    spans = MOST_SPAN * np.array(sizes[1:])

    def array(values: Any, dtype: Any) -> wp.array:
        return wp.array(values, dtype=dtype, device=model.device)

    table = HealthTable()
    table.near = min(float(spans.min()) / 2.0, reach) ** 2
    table.reach = reach**2
    table.spans = array(np.square(spans), float)
    table.origins, table.partners = array(origins, wp.int32), array(partners, wp.int32)
    return table
