"""Peer of gradients: Newton's explicit solver under Warp's tape, as its example of a cloth has it.

Its cloth has springs or triangles, and neither gas nor pressure. It keeps a state for each substep.
"""
# pyright: reportArgumentType=false, reportAssignmentType=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportGeneralTypeIssues=false, reportCallIssue=false

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.benchmarks.newton_peer import add_balloons, import_newton
from balloon_warp.model import Model
from balloon_warp.schedules.touch_table import triangles_of
from balloon_warp.system.warp_threads import recording


class NewtonTape:
    """Gradient of how far particles end from places, by their velocities at the start.

    Forward and backward are recorded once, and played again. Contacts are off.

    Args:
        targets: place of each particle at the end [m], shape (particle_count, 3).

    Raises:
        MissingExtraError: newton is not installed.
    """

    def __init__(self, model: Model, targets: NDArray[np.float64]):
        newton = import_newton()
        self._worlds, self._device = model.world_count, model.device
        built = _newton_model(newton, model)
        self._solver = newton.solvers.SolverSemiImplicit(built, enable_tri_contact=False)
        self._step_seconds = model.step_seconds
        self._states = [built.state() for _ in range(model.scene.frames * model.substeps + 1)]
        self._control = built.control()
        self._loss = wp.zeros(model.world_count, dtype=float, device=model.device, requires_grad=True)
        self._slopes = wp.full(model.world_count, 1.0, dtype=float, device=model.device)
        self._targets = wp.array(targets, dtype=wp.vec3, device=model.device)
        self._tape = wp.Tape()
        with recording(model.device) as capture:
            self._both_ways()
        self._graph = capture.graph

    def gradient(self) -> NDArray[np.float32]:
        """Return the derivatives, shape (world_count, particle_count, 3)."""
        self._tape.zero()
        wp.capture_launch(self._graph)
        return self._states[0].particle_qd.grad.numpy().reshape(self._worlds, -1, 3)

    def _both_ways(self) -> None:
        with self._tape:
            for now, after in zip(self._states, self._states[1:], strict=False):
                now.clear_forces()
                self._solver.step(now, after, self._control, None, self._step_seconds)
            self._loss.zero_()
            wp.launch(
                add_distances,
                self._states[-1].particle_q.shape,
                [self._states[-1].particle_q, self._targets],
                outputs=[self._loss],
                device=self._device,
            )
        self._tape.backward(grads={self._loss: self._slopes})


@wp.kernel
def add_distances(points: wp.array[wp.vec3], targets: wp.array[wp.vec3], loss: wp.array[float]):
    """Add squares of distances [m^2]; a thread a particle."""
    count = targets.shape[0]
    off = points[wp.tid()] - targets[wp.tid() % count]
    wp.atomic_add(loss, wp.tid() // count, wp.dot(off, off) / float(count))


@wp.kernel(enable_backward=False)
def by_distances(points: wp.array2d[wp.vec3], targets: wp.array[wp.vec3], slopes: wp.array2d[wp.vec3]):
    """Find derivatives of mean squares of distances; a thread a (world, particle)."""
    world, particle = wp.tid()
    slopes[world, particle] = (2.0 / float(targets.shape[0])) * (points[world, particle] - targets[particle])


def _newton_model(newton: Any, model: Model) -> Any:
    """Return the balloons with our springs; of rubber with its triangles, and without bending."""
    one = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    add_balloons(one, model)
    material = model.scene.balloon[0].material
    if material.shear_modulus and material.thickness:
        stiffness = material.shear_modulus * material.thickness
        corners = triangles_of(model.shapes[0].mesh)
        each = [stiffness] * len(corners)
        one.add_triangles(*corners.T.tolist(), tri_ke=each, tri_ka=each, tri_kd=[0.0] * len(corners))
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.replicate(one, model.world_count)
    built = builder.finalize(device=model.device, requires_grad=True)
    built.particle_grid = None
    return built
