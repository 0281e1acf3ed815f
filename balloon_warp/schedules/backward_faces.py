"""Small spheres that meet faces, backwards: the state before a substep's contacts is kept."""

from collections.abc import Mapping
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.face_log import CONTACTS_OF_A_SPHERE, FaceContact, LoggedFaces
from balloon_warp.kernels.adjoints.small_spheres import FaceBars, add_by_starts, faces_back_kernel
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.face_contact import MOST_LOOKS
from balloon_warp.kernels.working import Working
from balloon_warp.launching import launch, launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.backward_spheres import STATE_OF_SPHERES, SpheresBackward
from balloon_warp.schedules.launches import Moving, team_threads


class FacesBackward:
    """Run contacts of small spheres with faces backwards, a substep at a time.

    Args:
        columns: of the numbers that are derived by.
        working: of the launches that compute frames again.
        arrays: bars of the substep that runs backwards, by name.
        spheres: whose bars it turns into those of before the contacts.
    """

    def __init__(
        self, model: Model, features: Features, columns: tuple[int, ...], tables: Any, working: Any,
        arrays: Mapping[str, wp.array], spheres: SpheresBackward, room: Room,
    ):  # fmt: skip
        self._model, self._tables, self._working, self._spheres = model, tables, working, spheres
        self._back = faces_back_kernel(features, columns)
        self._came, self._again, self._log, self._bars = kept_of_faces(model, room)
        self._bars.points, self._bars.velocities = arrays["all_point_bar"], arrays["all_velocity_bar"]
        self._bars.gas_masses, self._bars.numbers = arrays["all_gas_mass_bar"], arrays["number_bars"]
        self._bars.spheres = spheres.bars

    def note(self, state: State, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Keep where particles and spheres are before they meet."""
        came = (points, velocities, *(getattr(state, name) for name in STATE_OF_SPHERES))
        for kept, array in zip(self._came[substep], came, strict=True):
            wp.copy(kept, array)

    def turn_back(self, substep: int, starts: wp.array) -> None:
        """Turn the bars of after the contacts into those of before, and of where the substep began.

        Args:
            starts: places of particles as the substep began.
        """
        model = self._model
        for again, kept in zip(self._again, self._came[substep], strict=True):
            wp.copy(again, kept)
        working = Working()
        for name in vars(Working.cls)["__annotations__"]:
            setattr(working, name, getattr(self._working, name))
        working.sphere_starts, working.point_starts = self._spheres.log.sphere_starts, starts
        launch_tiled(
            self._back, dim=[model.world_count],
            inputs=[self._tables, working, self._log, *self._again[:2], self._bars],
            block_dim=team_threads(model), device=model.device,
        )  # fmt: skip

    def add_by_starts(self) -> None:
        """Add the bars of where the substep began, once all else has run backwards."""
        model = self._model
        launch(add_by_starts, (model.world_count, model.particle_count), [self._bars], device=model.device)


def kept_of_faces(model: Model, room: Room) -> tuple[list[tuple[wp.array, ...]], tuple[wp.array, ...], Any, Any]:
    """Allocate the state before each substep's contacts, room to move it, the log of contacts, and bars."""
    worlds, particles, spheres = model.world_count, model.particle_count, model.sphere_count

    def moving() -> tuple[wp.array, ...]:
        of_particles: Moving = room.array((worlds, particles), wp.vec3), room.array((worlds, particles), wp.vec3)
        return (*of_particles, *(room.array((worlds, spheres), wp.vec3) for _ in STATE_OF_SPHERES))

    came, again = [moving() for _ in range(model.substeps)], moving()
    log = LoggedFaces()
    for name, array in zip(STATE_OF_SPHERES, again[2:], strict=True):
        setattr(log, name, array)
    log.contacts = room.array((worlds, CONTACTS_OF_A_SPHERE * spheres), FaceContact)
    log.counts = room.array(worlds, wp.int32)
    bars = FaceBars()
    bars.starts, bars.eases = room.array((worlds, particles), wp.vec3), room.array((worlds, particles), wp.float32)
    bars.parts = room.array((worlds, int(MOST_LOOKS)), wp.float32)
    return came, again, log, bars
