"""The pieces of a substep as launches, for schedules that launch a kernel for each: see `kernels.substep`."""

from typing import Any

import numpy as np
import warp as wp

from balloon_warp.kernels.laws.gas import Swelling
from balloon_warp.kernels.schedules.between import (
    correct_color,
    read_sphere_forces,
    write_sphere_forces,
)
from balloon_warp.kernels.schedules.launched import kernel_of_worlds, leave_kernel
from balloon_warp.kernels.schedules.launched_bodies import bodies_function, tumble_kernel
from balloon_warp.kernels.schedules.launched_edges import edges_function
from balloon_warp.kernels.schedules.launched_faces import faces_function
from balloon_warp.kernels.schedules.launched_gas import (
    LARGE,
    PARTICLES_OF_PART,
    flow_kernel,
    load_kernel,
    pump_kernel,
    swelling_kernel,
)
from balloon_warp.kernels.schedules.launched_roll import collide_kernel, roll_kernel
from balloon_warp.kernels.schedules.launched_touch import touch_kernel
from balloon_warp.kernels.schedules.launched_wear import wear_kernel
from balloon_warp.kernels.schedules.near import mark_count
from balloon_warp.kernels.schedules.working import Working
from balloon_warp.kernels.traits import Traits
from balloon_warp.launching import launch, launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.aims import AimRefresher
from balloon_warp.schedules.fixtures import forget_looks
from balloon_warp.schedules.membranes import left_array
from balloon_warp.schedules.ramp import note_pressures, refresh_ramp, weigh_air
from balloon_warp.schedules.solids import solid_arrays
from balloon_warp.schedules.tables import world_state
from balloon_warp.schedules.tears import TearPieces, tear_arrays
from balloon_warp.schedules.touching import TouchPieces, touch_arrays

SWELL_THREADS = 256
"""that sum how a balloon swells on a GPU; more would have too few registers"""
TOUCH_THREADS = 256
"""that go through the particles near spheres on a GPU"""


class Pieces:
    """Launches each piece for all worlds."""

    def __init__(self, model: Model, traits: Traits, tables: Any, room: Room, fast_math: bool = False):
        self.model, self.traits, self.tables = model, traits, tables
        self.working = Working()
        for name, array in working_arrays(model, traits, room).items():
            setattr(self.working, name, array)
        self._touching = TouchPieces(model, traits, tables, self.working, fast_math) if traits.touches else None
        self._tears = TearPieces(model, tables) if traits.bursts else None
        self._aims = AimRefresher(model, tables, room) if traits.aims else None
        places, split = model.columns.places, model.columns.balloon_width
        self._limit_column = places["correction_limit"] - split if traits.corrected else 0
        offsets = np.asarray(tables.correction.color_offsets.numpy())
        self._colors = list(zip(offsets[:-1].tolist(), np.diff(offsets).tolist(), strict=True))

    @staticmethod
    def allot(model: Model, traits: Traits, room: Room) -> None:
        """Ask for all memory that it keeps."""
        working_arrays(model, traits, room)
        left_array(model, room)
        tear_arrays(model, room)
        if traits.aims:
            AimRefresher.arrays(model, room)

    def begin_frame(self, state: State) -> None:
        """The ramp of what is keyframed, and the forces that the last frame left on spheres."""
        refresh_ramp(self.model, state)
        weigh_air(self.model, self.traits, self.tables, state)
        forget_looks(self.tables)
        if self.traits.penalties:
            self._over_spheres(read_sphere_forces, state.sphere_forces, self.working.sphere_quanta)
        if self.traits.gas and not self.traits.gas_changes:
            self._pump(state, 0.0)

    def refresh(self, points: wp.array) -> None:
        """The aims of normal forces."""
        if self._aims:
            self._aims.refresh(points, self.working.aims)

    def roll(self, state: State, time_in_frame: float) -> None:
        """Spheres move, by the paper's rule under the contacts of the substep before, and meet each other."""
        if self.model.sphere_count:
            now, starts = (self.tables, time_in_frame, state.frame), self.working.sphere_starts
            moving = state.sphere_positions, state.sphere_velocities, state.sphere_spins
            pushed = state.sphere_forces, self.working.sphere_quanta
            self._over_spheres(roll_kernel(self.traits), *now, *moving, *pushed, starts)
            if self.traits.spheres_meet:
                inputs = [*now, starts, *moving]
                launch(collide_kernel(self.traits), self.model.world_count, inputs, device=self.model.device)

    def tumble(self, state: State, time_in_frame: float) -> None:
        """Free bodies move, once spheres have."""
        m = self.model
        if self.traits.bodies:
            inputs = [self.tables, time_in_frame, world_state(state), self.working]
            launch(tumble_kernel(self.traits), m.world_count, inputs, device=m.device)

    def pump(self, state: State, time_in_frame: float) -> None:
        """Gas is pumped in, or let out."""
        if self.traits.gas_changes:
            self._pump(state, time_in_frame)

    def _pump(self, state: State, time_in_frame: float) -> None:
        inputs = [self.tables, time_in_frame, world_state(state), self.working]
        launch(pump_kernel(self.traits), self.model.world_count, inputs, device=self.model.device)

    def swell(
        self, state: State, time_in_frame: float, old: tuple[wp.array, wp.array], free_velocities: wp.array
    ) -> None:
        """The pressures of balloons, from how they would swell without them, and what flows by them."""
        m = self.model
        if self.traits.gas:
            threads = SWELL_THREADS if m.device.is_cuda else 1
            whole, parts = (m.world_count, m.balloon_count), self.working.swellings.shape
            inputs = [self.tables, time_in_frame, *old, free_velocities, world_state(state), self.working]
            place: dict[str, Any] = {"block_dim": threads, "device": m.device}
            if parts[2]:
                launch_tiled(swelling_kernel(self.traits), dim=parts, inputs=inputs, **place)
            kernel = load_kernel(self.traits, in_parts=parts[2] > 0)
            launch_tiled(kernel, dim=whole, inputs=inputs, **place)
        if self.traits.gas_flows:
            inputs = [self.tables, time_in_frame, world_state(state)]
            launch(flow_kernel(self.traits), m.world_count, inputs, device=m.device)

    def correct(self, state: State, time_in_frame: float, points: wp.array, velocities: wp.array) -> None:
        """Springs that are too long are shortened; then particles leave obstacles."""
        if not self.traits.corrected:
            return
        m = self.model
        for _ in range(m.scene.correction_sweeps):
            for first_spring, count in self._colors:
                inputs = [self.tables, self._limit_column, first_spring, points, velocities]
                launch(correct_color, (m.world_count, count), inputs, device=m.device)
        if self.traits.obstacles:
            moving = world_state(state), self.working, points, velocities
            self.over_particles(leave_kernel(self.traits), self.tables, time_in_frame, *moving)

    def wear(self, state: State, time_in_frame: float, points: wp.array) -> None:
        """What is left of the tensions of membranes that soften or tear."""
        if self.traits.wears:
            m = self.model
            inputs = [self.tables, points, state.peaks]
            launch(wear_kernel(self.traits), (m.world_count, m.triangle_count), inputs, device=m.device)
        if self._tears:
            self._tears.weigh(state, time_in_frame)
            self._tears.tear(state, world_state(state), time_in_frame, points)

    def press(self, state: State, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Balloons that touch push each other off; now and then it is found which may. Where particles are is kept for
        the spheres that meet faces."""
        if self.traits.small_spheres:
            wp.copy(self.working.point_starts, points)
        if self._touching:
            self._touching.search(state, substep, points, velocities)
            self._touching.press(state, points, velocities)

    def touch(self, state: State, time_in_frame: float, points: wp.array, velocities: wp.array) -> None:
        """Spheres and particles exchange momentum, as do bodies and particles, small spheres and faces, and
        edges."""
        m = self.model
        if self.traits.impulses:
            launch_tiled(
                touch_kernel(self.traits),
                dim=[m.world_count],
                inputs=[self.tables, time_in_frame, world_state(state), self.working, points, velocities],
                block_dim=TOUCH_THREADS if m.device.is_cuda else 1,
                device=m.device,
            )
        meetings = {
            bodies_function: self.traits.bodies > 0,
            faces_function: self.traits.small_spheres,
            edges_function: self.traits.edges_meet,
        }
        for meeting in [meeting for meeting, happens in meetings.items() if happens]:
            launch_tiled(
                kernel_of_worlds(meeting(self.traits)),
                dim=[m.world_count],
                inputs=[self.tables, world_state(state), self.working, points, velocities],
                block_dim=TOUCH_THREADS if m.device.is_cuda else 1,
                device=m.device,
            )

    def end_frame(self, state: State) -> None:
        """What the last substep leaves on spheres, and the pressures that it had."""
        if self.traits.penalties:
            self._over_spheres(write_sphere_forces, self.working.sphere_quanta, state.sphere_forces)
        note_pressures(self.model, self.traits, state)

    def over_particles(self, kernel: Any, *arguments: Any) -> None:
        """Launch a thread a (world, particle)."""
        model = self.model
        launch(kernel, (model.world_count, model.particle_count), inputs=list(arguments), device=model.device)

    def _over_spheres(self, kernel: Any, *arguments: Any) -> None:
        model = self.model
        if model.sphere_count:
            shape = (model.world_count, model.sphere_count)
            launch(kernel, shape, inputs=list(arguments), device=model.device)


def working_arrays(model: Model, traits: Traits, room: Room) -> dict[str, Any]:
    """What the pieces tell each other; empty where a scene does not need it."""
    worlds = model.world_count
    largest = int(np.diff(model.particle_offsets).max())
    parts = -(-largest // PARTICLES_OF_PART) if largest > LARGE else 0

    def vectors(needed: bool) -> Any:
        return room.array((worlds, model.particle_count if needed else 0), wp.vec3)

    return {
        "swellings": room.array((worlds, model.balloon_count, parts if traits.gas else 0), Swelling),
        "aims": vectors(traits.aims),
        "area_vectors": vectors(traits.measures_areas),
        "inflations": vectors(traits.keeps_inflations),
        "sphere_quanta": room.array((worlds, model.sphere_count if traits.penalties else 0, 3), wp.int64),
        **solid_arrays(model, traits, room),
        **touch_arrays(model, traits, room),
        "near": room.array((worlds, mark_count(model.particle_count) if traits.impulses else 0), wp.int32),
    }
