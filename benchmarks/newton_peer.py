"""Newton's `SolverSemiImplicit` on the same balloons: its springs and its integrator, with our gravity, damping and
inflation written into its particle forces, since it has no inflation."""

from typing import Any

import numpy as np
import warp as wp

from balloon_warp.errors import MissingExtraError
from balloon_warp.kernels.laws.hooke import KINDS
from balloon_warp.kernels.motion import set_body_forces
from balloon_warp.model import Model, State
from balloon_warp.schedules.refresh import AimRefresher, refresh_ramp


class NewtonPeer:
    """Advances the model's worlds by frames, like a schedule; spheres and ground are left out.

    Raises:
        MissingExtraError: newton is not installed.
    """

    name = "newton"
    capturable = True

    def __init__(self, model: Model):
        try:
            import newton
        except ImportError:
            raise MissingExtraError("the peer needs newton: pip install 'balloon-warp[bench]'") from None
        self.model = model
        self._newton = _newton_model(newton, model)
        self._solver = newton.solvers.SolverSemiImplicit(self._newton)
        self._states = self._newton.state(), self._newton.state()
        self._control = self._newton.control()
        self._aims = AimRefresher(model)

    def advance_frame(self, state: State) -> None:
        """One frame, of Newton's own state; the aims and ramp of `state` serve as working memory."""
        model = self.model
        refresh_ramp(model, state)
        now, after = self._states
        for substep in range(model.substeps):
            if substep == 0 or model.scene.normals == "fresh":
                self._aims.refresh(self._rows(now.particle_q), state.inflation_aims)
            wp.launch(
                set_body_forces,
                (model.world_count, model.particle_count),
                inputs=[
                    *(model.particle_balloon, model.particle_mass_share),
                    *(model.parameters[name] for name in ("mass", "helium", "damping", "gravity")),
                    *(model.inflation_kind, model.up, substep * model.step_seconds),
                    *(self._rows(now.particle_qd), state.inflation_aims, state.inflation_ramp),
                    self._rows(now.particle_f),
                ],
                device=model.device,
            )
            self._solver.step(now, after, self._control, None, model.step_seconds)
            now, after = after, now
        if now is not self._states[0]:
            wp.copy(self._states[0].particle_q, now.particle_q)
            wp.copy(self._states[0].particle_qd, now.particle_qd)

    @property
    def points(self) -> wp.array:
        """[m], shape (world_count, particle_count), vec3"""
        return self._rows(self._states[0].particle_q)

    def _rows(self, array: wp.array) -> wp.array:
        return array.reshape((self.model.world_count, self.model.particle_count))


def _newton_model(newton: Any, model: Model) -> Any:
    """The balloons as Newton's particles and springs, without its gravity and without contacts between particles."""
    balloon = np.asarray(model.particle_balloon.numpy(), dtype=np.int64)
    pairs = np.asarray(model.spring_particles.numpy(), dtype=np.int64)
    kind = np.asarray(model.spring_kind.numpy(), dtype=np.int64)
    points = model.initial_points.numpy().tolist()
    masses = (model.particle_mass_share.numpy() * np.asarray(model.parameters["mass"].numpy())[0, balloon]).tolist()
    constants = np.stack([model.parameters[row.name].numpy()[0] for row in KINDS], axis=1)
    by_kind = constants[balloon[pairs[:, 0]], kind]
    one = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    one.add_particles(points, [(0.0, 0.0, 0.0)] * len(points), masses)
    for (p, q), stiffness in zip(pairs.tolist(), by_kind * model.spring_stiffness_scale.numpy(), strict=True):
        one.add_spring(p, q, ke=float(stiffness), kd=0.0, control=0.0)
    one.spring_rest_length = model.spring_rest_length.numpy().tolist()
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.replicate(one, model.world_count)
    built = builder.finalize(device=model.device)
    built.particle_grid = None
    assert built.particle_count == model.world_count * model.particle_count
    assert np.isclose(built.particle_mass.numpy().sum(), model.world_count * sum(masses), rtol=1e-3)
    return built
