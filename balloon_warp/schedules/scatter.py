"""The `scatter` schedule: a thread a spring, a face or a particle, with atomic adds into one force array.

The readable reference that every other schedule is tested against.
"""

from collections.abc import Iterator
from typing import Any

import warp as wp

from balloon_warp.kernels.contact import move_spheres, resolve_contacts
from balloon_warp.kernels.inflation import add_face_areas, aim_inflation, measure_faces, ramp_inflation
from balloon_warp.kernels.motion import euler_kernel, set_body_forces
from balloon_warp.kernels.springs import add_rubber_forces, add_spring_forces, add_string_forces
from balloon_warp.kernels.torsion import add_torsion_forces
from balloon_warp.kernels.water import add_water_forces, add_water_loads
from balloon_warp.model import Model, State
from balloon_warp.model.memory import VECTOR_BYTES
from balloon_warp.schedules.correct import Corrector
from balloon_warp.schedules.health import HealthCheck
from balloon_warp.schedules.scatter_air import ScatterAir
from balloon_warp.schedules.tables import body_table, face_table, hinge_table, water_table
from balloon_warp.schedules.traits import model_traits


class ScatterSchedule:
    """Advances a state by whole frames, in place."""

    name = "scatter"
    capturable = True

    def __init__(self, model: Model):
        worlds, device = model.world_count, model.device
        self.model = model
        self._health = HealthCheck(model)
        self._traits = model_traits(model)
        self._corrector = Corrector(model)
        self._hinges = hinge_table(model)
        self.forces = wp.zeros((worlds, model.particle_count), dtype=wp.vec3, device=device)
        """net force on each particle [N], shape (world_count, particle_count)"""
        self._face_centers = wp.zeros((worlds, model.face_count), dtype=wp.vec3, device=device)
        self._face_area_vectors = wp.zeros((worlds, model.face_count), dtype=wp.vec3, device=device)
        self._balloon_areas = wp.zeros((worlds, model.balloon_count), dtype=float, device=device)
        self._water, self._faces, self._bodies = water_table(model), face_table(model), body_table(model)
        self._water_loads = wp.zeros(
            (worlds, model.particle_count if model.has_water else 0), dtype=wp.vec4, device=device
        )
        self._air = ScatterAir(model) if model.in_air else None

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        in_air = ScatterAir.world_bytes(model) if model.in_air else 0
        in_water = 16 * model.particle_count if model.has_water else 0
        vectors = model.particle_count + 2 * model.face_count
        return VECTOR_BYTES * vectors + 4 * model.balloon_count + in_air + in_water

    def advance_frame(self, state: State) -> None:
        """One frame: the inflation refreshed, then every substep."""
        for _ in self.substeps(state):
            pass

    def substeps(self, state: State) -> Iterator[int]:
        """One frame that pauses after each substep, with its number from 0."""
        model = self.model
        self.refresh_inflation(state)
        for substep in range(model.substeps):
            if substep > 0 and model.scene.normals == "fresh":
                self._aim_inflation(state)
            self._advance_substep(state, substep * model.step_seconds)
            yield substep
        self._health.end_frame(state)

    def _advance_substep(self, state: State, time_in_frame: float) -> None:
        self._move_spheres(state)
        if self._air:
            self._air.move_gas(state, time_in_frame)
        self.sum_forces(state, time_in_frame)
        if self._air:
            self._air.add_forces(state, time_in_frame, self.forces)
        self._integrate(state)
        self._corrector.correct(state.points, state.velocities)
        self._resolve_contacts(state, time_in_frame)

    def refresh_inflation(self, state: State) -> None:
        """What a frame begins with: its ramp of k_normal, and each particle's aim."""
        self._ramp_inflation(state)
        self._aim_inflation(state)

    def sum_forces(self, state: State, time_in_frame: float = 0.0) -> None:
        """Fill `forces` with the net force on each particle."""
        self._set_body_forces(state, time_in_frame)
        self._add_spring_forces(state)
        self._add_torsion_forces(state)
        self._add_string_forces(state)
        self._add_water_forces(state)

    def _ramp_inflation(self, state: State) -> None:
        m = self.model
        self._launch(
            ramp_inflation,
            (m.world_count, m.balloon_count),
            *(m.keyframe_times, m.keyframe_values, m.frame_seconds),
            state.frame,
            state.inflation_ramp,
        )

    def _aim_inflation(self, state: State) -> None:
        m = self.model
        self._launch(
            measure_faces,
            (m.world_count, m.face_count),
            *(m.face_offsets, m.face_particles),
            state.points,
            *(self._face_centers, self._face_area_vectors),
        )
        self._balloon_areas.zero_()
        self._launch(
            add_face_areas, (m.world_count, m.face_count), m.face_balloon, self._face_area_vectors, self._balloon_areas
        )
        self._launch(
            aim_inflation,
            (m.world_count, m.particle_count),
            *(m.particle_balloon, m.particle_face_offsets, m.particle_faces),
            *(state.points, self._face_centers, self._face_area_vectors, self._balloon_areas),
            state.inflation_aims,
        )

    def _set_body_forces(self, state: State, time_in_frame: float) -> None:
        m = self.model
        self._launch(
            set_body_forces,
            (m.world_count, m.particle_count),
            *(m.particle_balloon, m.particle_mass_share, m.mass, m.helium, m.damping, m.gravity),
            *(m.inflation_kind, m.up, time_in_frame),
            *(state.velocities, state.inflation_aims, state.inflation_ramp),
            self.forces,
        )

    def _add_spring_forces(self, state: State) -> None:
        m = self.model
        springs = m.spring_particles, m.spring_kind, m.spring_rest_length, m.spring_stiffness_scale
        constants = m.particle_balloon, m.stiffness
        dim = m.world_count, m.spring_count
        if self._traits.rubber:
            rubber = m.viscosity, m.yield_stretch, m.correction_limit, m.scene.correction == "tarantino"
            moving = state.points, state.velocities
            self._launch(add_rubber_forces, dim, *springs, *constants, *rubber, *moving, self.forces)
        else:
            self._launch(add_spring_forces, dim, *springs, *constants, state.points, self.forces)

    def _add_torsion_forces(self, state: State) -> None:
        m = self.model
        if self._traits.torsion:
            dim = m.world_count, self._hinges.ends.shape[0]
            self._launch(add_torsion_forces, dim, self._hinges, m.particle_balloon, state.points, self.forces)

    def _add_string_forces(self, state: State) -> None:
        m = self.model
        if m.string_count:
            self._launch(
                add_string_forces,
                (m.world_count, m.string_count),
                *(m.string_particle, m.string_anchor, m.string_length, m.string_stiffness),
                state.points,
                self.forces,
            )

    def _add_water_forces(self, state: State) -> None:
        m = self.model
        if m.has_water:
            self._water_loads.zero_()
            self._launch(
                add_water_loads,
                (m.world_count, m.face_count),
                *(self._water, self._faces, self._bodies),
                state.points,
                self._water_loads,
            )
            self._launch(
                add_water_forces,
                (m.world_count, m.particle_count),
                *(self._water, self._bodies, m.step_seconds),
                *(self._water_loads, state.velocities),
                self.forces,
            )

    def _integrate(self, state: State) -> None:
        m = self.model
        mass = self._air.masses if self._air else m.mass
        self._launch(
            euler_kernel(self._traits.forward_euler),
            (m.world_count, m.particle_count),
            *(m.particle_balloon, m.particle_mass_share, mass, m.step_seconds),
            *(self.forces, state.points, state.velocities),
            *(state.points, state.velocities),
        )

    def _move_spheres(self, state: State) -> None:
        m = self.model
        if m.sphere_count:
            self._launch(
                move_spheres,
                (m.world_count, m.sphere_count),
                *(m.sphere_mass, m.sphere_radius, m.gravity, m.up),
                *(m.ground_height, m.ground_restitution, m.step_seconds),
                *(state.sphere_positions, state.sphere_velocities, state.sphere_forces),
            )

    def _resolve_contacts(self, state: State, time_in_frame: float) -> None:
        m = self.model
        mass = self._air.masses if self._air else m.mass
        if m.sphere_count or m.scene.ground:
            self._launch(
                resolve_contacts,
                (m.world_count, m.particle_count),
                *(m.particle_balloon, m.particle_mass_share, mass, m.inflation_kind),
                *(m.sphere_mass, m.sphere_radius, m.sphere_penalty),
                *(m.up, m.ground_height, m.ground_friction),
                *(self._traits.impulses, m.step_seconds, time_in_frame),
                *(state.inflation_aims, state.inflation_ramp, state.inflation_loads),
                *(state.sphere_positions, state.sphere_velocities),
                *(state.points, state.velocities),
                *(state.points, state.velocities, state.sphere_forces),
            )

    def _launch(self, kernel: Any, dim: int | tuple[int, ...], *arguments: Any) -> None:
        wp.launch(kernel, dim, inputs=list(arguments), device=self.model.device)
