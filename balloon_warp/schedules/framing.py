"""Work of every schedule before and after the substeps of a frame."""

from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.schedules.launched import read_sphere_forces, write_sphere_forces
from balloon_warp.model import Model, State
from balloon_warp.schedules.frames import ContactSums, HealthCheck
from balloon_warp.schedules.tables import (
    clear_clearances,
    note_pressures,
    place_anchors,
    place_obstacles,
    refresh_ramp,
    update_air,
)
from balloon_warp.system.warp_threads import launch


class Framing:
    """Begin and end frames of a model.

    Args:
        tables: that the schedule has made of it.
        working: the memory of its kernels beside the state; None where they keep nothing from frame to frame.
        numbers: of particles in the state, if tables have them in another order.
        checks_particles: whether particles are looked at as a frame ends; otherwise kernels have done so.
    """

    def __init__(
        self,
        model: Model,
        features: Features,
        tables: Any,
        working: Any | None = None,
        *,
        numbers: wp.array | None = None,
        checks_particles: bool = True,
    ):
        self.model, self.features, self.tables, self.working = model, features, tables, working
        self._numbers = numbers
        self._contact_sums = ContactSums(model) if features.tells_contacts else None
        self._health = HealthCheck(model, particles=checks_particles)

    def begin(self, state: State) -> None:
        """Update the values that depend on the frame, and read the forces that the last frame left on spheres."""
        refresh_ramp(self.model, state)
        update_air(self.model, self.features, self.tables, state, self._numbers)
        place_obstacles(self.model, self.tables, state)
        place_anchors(self.model, self.tables, state)
        clear_clearances(self.tables)
        if self.working and self.features.tells_contacts:
            self.working.contact_impulses.zero_()
        if self.working and self.features.penalties:
            self._over_spheres(read_sphere_forces, state.sphere_forces, self.working.sphere_quanta)

    def end(self, state: State) -> None:
        """End a frame: store sphere forces and pressures of the last substep, count it, and check all particles."""
        if self.working and self.features.penalties:
            self._over_spheres(write_sphere_forces, self.working.sphere_quanta, state.sphere_forces)
        note_pressures(self.model, self.features, state)
        if self.working and self._contact_sums:
            wp.copy(state.contact_impulses, self.working.contact_impulses)
            self._contact_sums(state)
        self._health.end_frame(state)

    def _over_spheres(self, kernel: Any, *arguments: Any) -> None:
        shape = (self.model.world_count, self.model.sphere_count)
        launch(kernel, shape, inputs=list(arguments), device=self.model.device)
