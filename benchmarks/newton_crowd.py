"""Peer of balloons that touch: Newton's `SolverVBD` with self-contact.

Its implicit solver of springs has our damping and pressure written into its particle forces, since it has no inflation.
"""
# pyright: reportArgumentType=false, reportAssignmentType=false, reportIndexIssue=false, reportOperatorIssue=false

from typing import Any

import numpy as np
import warp as wp

from balloon_warp.benchmarks.newton_peer import add_balloons, import_newton
from balloon_warp.model import Model, State
from balloon_warp.model.touch import THICKNESS, edge_length
from balloon_warp.schedules.touch_table import triangles_of

STEP_SECONDS = 1.0 / 600.0
"""ten steps in the sixtieth part of a second, as Newton's examples of cloth that touches itself; and as in that of a
twisted one (`cloth_twist`):"""
ITERATIONS = 4
STIFFNESS, DAMPING, FRICTION = 1.0e3, 1.0e-1, 0.2
"""of a contact"""


class NewtonCrowd:
    """Advances one world's balloons of a given pressure by frames, like a schedule; all else is left out.

    Its surfaces keep as far apart as ours do, and its lists reach as far again, as it recommends. Edges against edges
    are left out, as with us: they would take most of its time.

    Raises:
        MissingExtraError: newton is not installed.
    """

    name = "newton"
    capturable = True

    def __init__(self, model: Model):
        newton = import_newton()
        self.model = model
        self._newton = _newton_model(newton, model)
        skin = THICKNESS * edge_length(model.shapes[0].mesh)
        self._solver = newton.solvers.SolverVBD(
            self._newton,
            iterations=ITERATIONS,
            particle_enable_self_contact=True,
            particle_self_contact_margin=skin,
            particle_self_contact_gap=skin,
        )
        self._states = self._newton.state(), self._newton.state()
        self._control = self._newton.control()
        self._substeps = 2 * round(0.5 * model.frame_seconds / STEP_SECONDS)
        balloon = model.scene.balloon[0]
        self._pressure = float(balloon.inflation.pressure)
        self._damping = balloon.damping / (model.particle_count / model.balloon_count)

    def advance_frame(self, state: State) -> None:
        """Advance Newton's own state by a frame."""
        now, after = self._states
        self._solver.rebuild_bvh(now)
        for _ in range(self._substeps):
            wp.launch(
                damp,
                self._newton.particle_count,
                [now.particle_qd, self._damping],
                outputs=[now.particle_f],
                device=self.model.device,
            )
            wp.launch(
                inflate,
                self._newton.tri_count,
                [self._newton.tri_indices, now.particle_q, self._pressure],
                outputs=[now.particle_f],
                device=self.model.device,
            )
            self._solver.step(now, after, self._control, None, self.model.frame_seconds / self._substeps)
            now, after = after, now

    @property
    def points(self) -> np.ndarray:
        """Points of the balloons [m], shape (particle_count, 3)."""
        return self._states[0].particle_q.numpy()


@wp.kernel(enable_backward=False)
def damp(velocities: wp.array[wp.vec3], damping: float, forces: wp.array[wp.vec3]):
    """Set the drag of a particle [N]; a thread a particle."""
    forces[wp.tid()] = -damping * velocities[wp.tid()]


@wp.kernel(enable_backward=False)
def inflate(triangles: wp.array2d[wp.int32], points: wp.array[wp.vec3], pressure: float, forces: wp.array[wp.vec3]):
    """Add a third of a triangle's pressure force to each corner [N]; a thread a triangle."""
    triangle = wp.tid()
    a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
    third = (pressure / 6.0) * wp.cross(points[b] - points[a], points[c] - points[a])
    wp.atomic_add(forces, a, third)
    wp.atomic_add(forces, b, third)
    wp.atomic_add(forces, c, third)


def _newton_model(newton: Any, model: Model) -> Any:
    """Return the balloons with our springs, and triangles that only touch; colored, as the solver wants it."""
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    add_balloons(builder, model)
    triangles = [
        triangles_of(shape.mesh) + first for shape, first in zip(model.shapes, model.particle_offsets[:-1], strict=True)
    ]
    soft = [0.0] * sum(map(len, triangles))
    builder.add_triangles(*np.concatenate(triangles).T.tolist(), tri_ke=soft, tri_ka=soft, tri_kd=soft)
    builder.color()
    built = builder.finalize(device=model.device)
    flags = built.particle_flags.numpy()
    flags[model.particle_mass_share.numpy() == 0.0] &= ~int(newton.ParticleFlags.ACTIVE)
    built.particle_flags.assign(flags)
    built.soft_contact_ke, built.soft_contact_kd, built.soft_contact_mu = STIFFNESS, DAMPING, FRICTION
    return built
