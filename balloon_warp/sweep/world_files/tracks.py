"""Tracks: the parts of a simulator's frame that go into the files of worlds."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.contacts import things_of
from balloon_warp.model import Model, ModelPlan
from balloon_warp.outputs.world_files import Field
from balloon_warp.outputs.world_files.formats import AXES
from balloon_warp.simulator import Simulator
from balloon_warp.warp_lock import lock_of


@dataclass(frozen=True)
class Track:
    """An array of the state, or an observation, as it goes into files."""

    name: str
    source: str
    dimensions: tuple[str, ...]
    """Names of the track's dimensions, after the world's"""
    unit: str
    meaning: str
    dtype: str = "<f4"


TRACKS = (
    Track("mesh_pos", "points", ("particle", "axis"), "m", "positions of particles"),
    Track("velocity", "velocities", ("particle", "axis"), "m/s", "velocities of particles"),
    Track("pressure", "pressures", ("balloon",), "Pa", "gauge pressures, 0 without pressure or gas"),
    Track("volume", "volumes", ("balloon",), "m^3", "enclosed volumes"),
    Track("gas_amount", "gas_amounts", ("balloon",), "mol", "amounts of gas, 0 without gas", "<f8"),
    Track(
        *("contact_force", "contact_forces", ("balloon", "thing", "axis"), "N"),
        "net force of each of `things` on each balloon, averaged over the frame before; where the scene has contacts",
    ),
    Track(
        *("particle_contact_force", "particle_contact_forces", ("particle", "axis"), "N"),
        "force of all things on each particle in contact, averaged over the frame before; where the scene has contacts",
    ),
    Track("sphere_pos", "sphere_positions", ("sphere", "axis"), "m", "positions of spheres"),
    Track("sphere_velocity", "sphere_velocities", ("sphere", "axis"), "m/s", "velocities of spheres"),
    Track("body_pos", "body_positions", ("body", "axis"), "m", "positions of free bodies"),
    Track("body_turn", "body_turns", ("body", "quaternion"), "1", "turns of free bodies: x, y, z, w"),
)
"""Tracks in the order of the files"""
OF_CONTACTS = ("contact_forces", "particle_contact_forces")
"""Sources that only scenes with contacts have"""
OBSERVED = ("volumes", "particle_contact_forces")
"""Sources that are observations"""
HEALTH = (
    "health",
    ("time",),
    "<i4",
    "1",
    "1; 0 from the frame in which the world blew up; 2 if restarted with shorter steps",
)


def tracks_of(plan: ModelPlan | Model) -> dict[Track, tuple[int, ...]]:
    """Find the tracks that a world has of `TRACKS`, and their shapes."""
    scene = plan.scene
    counts = AXES | {
        "particle": sum(shape.mesh.vertex_count for shape in plan.shapes),
        "balloon": len(plan.shapes),
        "thing": len(things_of(plan)),
        "sphere": len(scene.sphere),
        "body": len(scene.body),
    }
    told = [track for track in TRACKS if scene.contacts or track.source not in OF_CONTACTS]
    shapes = {track: tuple(counts[name] for name in track.dimensions) for track in told}
    return {track: shape for track, shape in shapes.items() if all(shape)}


def fields_of(plan: ModelPlan, frames: int) -> list[Field]:
    """Describe the moving arrays of a world's file."""
    moving = [
        Field(track.name, ("time", *track.dimensions), (frames, *shape), track.dtype, track.unit, track.meaning)
        for track, shape in tracks_of(plan).items()
    ]
    name, dimensions, dtype, unit, meaning = HEALTH
    return [*moving, Field(name, dimensions, (frames,), dtype, unit, meaning)]


def bytes_of_frame(plan: ModelPlan) -> int:
    """Return the memory of a world's frame."""
    return sum(field.bytes_of_frame for field in fields_of(plan, 1))


class Tracker:
    """Reads the tracks that go into files from a simulator.

    Args:
        simulator: of the worlds.
        every: which frames are read: 2 for every second.
    """

    def __init__(self, simulator: Simulator, every: int):
        self._every, self._simulator = every, simulator
        self._tracks = tracks_of(simulator.model)
        with lock_of(simulator.model.device):
            self._sources = {
                track.name: simulator.observations[track.source] for track in self._tracks if track.source in OBSERVED
            }

    def read(self) -> dict[str, NDArray] | None:
        """Read the frame that the simulator is at, if it is one of those, shape (world_count, ...) each."""
        if self._simulator.frame_number % self._every:
            return None
        return {track.name: self._copy(track, shape) for track, shape in self._tracks.items()}

    def _copy(self, track: Track, shape: tuple[int, ...]) -> NDArray:
        source: Any = self._sources.get(track.name)
        values = (getattr(self._simulator.state, track.source) if source is None else source).numpy()
        return np.array(values, dtype=track.dtype).reshape(len(values), *shape)  # a copy: on a CPU they go on changing
