"""Peer of free balloons: Newton's `SolverSemiImplicit`.

Its springs and integrator have our gravity, damping and inflation written into its particle forces, since it has no
inflation.
"""
# pyright: reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false, reportIndexIssue=false

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.errors import MissingExtraError
from balloon_warp.kernels.compose import params_functions, ramp_at
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.kernels.phases.inflation import push_along_direction
from balloon_warp.kernels.schedules.launched import GATHERED
from balloon_warp.kernels.schedules.writer import cut
from balloon_warp.kernels.substep import AIMING, phases_of
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.model import Model, State
from balloon_warp.model.state import Allocating
from balloon_warp.schedules.launched import Launches
from balloon_warp.schedules.tables import make_tables, model_features, refresh_ramp, world_state


class NewtonPeer:
    """Advances the model's worlds by frames, like a schedule; spheres and ground are left out.

    Raises:
        MissingExtraError: newton is not installed.
    """

    name = "newton"
    capturable = True

    def __init__(self, model: Model):
        newton = import_newton()
        self.model = model
        self._newton = _newton_model(newton, model)
        self._solver = newton.solvers.SolverSemiImplicit(self._newton)
        self._states = self._newton.state(), self._newton.state()
        self._control = self._newton.control()
        self._features = model_features(model)
        self._tables, room = make_tables(model, self._features), Allocating(model.device)
        aiming = cut(phases_of(self._features, AIMING), self._features, GATHERED, shown=("inflation_direction",))
        self._aiming = Launches(model, aiming, self._tables, room)

    def advance_frame(self, state: State) -> None:
        """Advance Newton's own state by a frame; the ramp of `state` serves as working memory."""
        model = self.model
        refresh_ramp(model, state)
        now, after = self._states
        for substep in range(model.substeps):
            if substep == 0 or model.scene.normals == "fresh":
                self._aiming.substep(state, 0, (self._rows(now.particle_q), self._rows(now.particle_qd)))
            wp.launch(
                outer_force_kernel(self._features),
                (model.world_count, model.particle_count),
                inputs=[
                    *(self._tables, substep * model.step_seconds, self._rows(now.particle_qd)),
                    *(world_state(state), self._aiming.values["inflation_direction"]),
                ],
                outputs=[self._rows(now.particle_f)],
                device=model.device,
            )
            self._solver.step(now, after, self._control, None, model.step_seconds)
            now, after = after, now
        if now is not self._states[0]:
            wp.copy(self._states[0].particle_q, now.particle_q)
            wp.copy(self._states[0].particle_qd, now.particle_qd)

    @property
    def points(self) -> wp.array:
        """Points of the balloons [m], shape (world_count, particle_count), vec3."""
        return self._rows(self._states[0].particle_q)

    def _rows(self, array: wp.array) -> wp.array:
        return array.reshape((self.model.world_count, self.model.particle_count))


def import_newton() -> Any:
    """Import Newton.

    Raises:
        MissingExtraError: newton is not installed.
    """
    try:
        import newton
    except ImportError:
        raise MissingExtraError("the peer needs newton: pip install 'balloon-warp[bench]'") from None
    return newton


@cache
def outer_force_kernel(features: Features) -> Any:
    """Return the kernel of the forces that Newton lacks: laws on particles, and the inflation."""
    _, read_params = params_functions(features.columns, features.balloons)
    particle_laws = features.laws_on("particle")

    @wp.kernel(module="unique", enable_backward=False)
    def set_outer_forces(
        t: Tables,
        time_in_frame: float,
        velocities: wp.array2d[wp.vec3],
        state: WorldState,
        aims: wp.array2d[wp.vec3],
        # out
        forces: wp.array2d[wp.vec3],
    ):
        """Set the outer forces; a thread a (world, particle)."""
        world, particle = wp.tid()
        own = read_params(t, world, particle)
        value = ramp_at(state, world, own.balloon, time_in_frame)
        push = push_along_direction(value, aims[world, particle])
        forces[world, particle] = push + particle_laws(
            wp.vec3(), velocities[world, particle], own.mass, own.share, wp.vec3(), wp.vec4(), t.up, t.step_seconds,
            time_in_frame, own.n,
        )  # fmt: skip

    return set_outer_forces


def add_balloons(builder: Any, model: Model) -> None:
    """Add the balloons of a world as Newton's particles and springs."""
    balloon = np.asarray(model.particle_balloon.numpy(), dtype=np.int64)
    pairs = np.asarray(model.spring_particles.numpy(), dtype=np.int64)
    kind = np.asarray(model.spring_kind.numpy(), dtype=np.int64)
    points = model.initial_points.numpy().tolist()
    masses = (model.particle_mass_share.numpy() * np.asarray(model.parameters["mass"].numpy())[0, balloon]).tolist()
    constants = np.stack([model.parameters[row.name].numpy()[0] for row in KINDS], axis=1)
    by_kind = constants[balloon[pairs[:, 0]], kind]
    builder.add_particles(points, [(0.0, 0.0, 0.0)] * len(points), masses)
    for (p, q), stiffness in zip(pairs.tolist(), by_kind * model.spring_stiffness_scale.numpy(), strict=True):
        builder.add_spring(p, q, ke=float(stiffness), kd=0.0, control=0.0)
    builder.spring_rest_length = model.spring_rest_length.numpy().tolist()


def _newton_model(newton: Any, model: Model) -> Any:
    """Return the balloons without Newton's gravity and without contacts between particles.

    Newton damps by the velocity before a step, we by that after it: with a mass of m + h c both are the same.
    """
    one = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    add_balloons(one, model)
    damping, masses = (np.asarray(model.parameters[name].numpy())[0] for name in ("damping", "mass"))
    inertia = 1.0 + model.step_seconds * (damping / masses)[model.particle_balloon.numpy()]
    one.particle_mass = (inertia * one.particle_mass).tolist()
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.replicate(one, model.world_count)
    built = builder.finalize(device=model.device)
    built.particle_grid = None
    assert built.particle_count == model.world_count * model.particle_count
    assert np.isclose(built.particle_mass.numpy().sum(), model.world_count * sum(one.particle_mass), rtol=1e-3)
    return built
