"""From a model to the tables that the schedules without atomics read."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.tables import (
    CHUNK,
    SLICE,
    AirTable,
    BodyTable,
    CorrectionTable,
    FaceTable,
    HingeTable,
    ObstacleTable,
    SpringTable,
    StringTable,
    WaterTable,
    WorldState,
)
from balloon_warp.model import Model, State
from balloon_warp.schedules.traits import model_traits
from balloon_warp.springs.coloring import color_springs


@dataclass(frozen=True)
class SpringEnds:
    """Every spring twice, from each of its ends, sorted by particle, kind and neighbor."""

    particle: NDArray[np.int64]
    neighbor: NDArray[np.int64]
    kind: NDArray[np.int64]
    scale: NDArray[np.float64]
    """its constant over that of its kind"""
    rest_length: NDArray[np.float64]
    """[m]"""
    by_kind: NDArray[np.int64]
    """springs of each kind at each particle, shape (particle_count, 3)"""

    @property
    def vary(self) -> bool:
        """Whether springs of one kind differ."""
        return bool((self.scale != 1.0).any())


def spring_ends(model: Model) -> SpringEnds:
    """The model's springs as its particles see them."""
    ends = model.spring_particles.numpy().astype(np.int64)
    kind = np.tile(model.spring_kind.numpy().astype(np.int64), 2)
    particle, neighbor = np.concatenate([ends, ends[:, ::-1]]).T
    order = np.lexsort([neighbor, kind, particle])
    count = model.particle_count
    return SpringEnds(
        particle=particle[order],
        neighbor=neighbor[order],
        kind=kind[order],
        scale=np.tile(np.asarray(model.spring_stiffness_scale.numpy(), dtype=np.float64), 2)[order],
        rest_length=np.tile(np.asarray(model.spring_rest_length.numpy(), dtype=np.float64), 2)[order],
        by_kind=np.bincount(3 * particle + kind, minlength=3 * count).reshape(count, 3),
    )


def spring_table(model: Model, ends: SpringEnds) -> Any:
    """Each particle's springs in slices of 32 particles."""
    valence = ends.by_kind.sum(axis=1)
    slot = np.arange(len(ends.particle)) - np.repeat(np.cumsum(valence) - valence, valence)
    padded = np.zeros(-(-model.particle_count // SLICE) * SLICE, dtype=np.int64)
    padded[: model.particle_count] = -(-valence // CHUNK) * CHUNK
    widths = padded.reshape(-1, SLICE).max(axis=1)
    slice_offsets = SLICE * np.cumsum(np.append(0, widths))
    place = slice_offsets[ends.particle // SLICE] + SLICE * slot + ends.particle % SLICE
    # What fills up a particle's slots are springs of no stiffness from the particle to itself.
    in_slice = np.arange(slice_offsets[-1]) % SLICE
    own = np.minimum(np.repeat(np.arange(len(widths)), SLICE * widths) * SLICE + in_slice, model.particle_count - 1)
    end = 4 * own
    end[place] = 4 * ends.neighbor + ends.kind

    def placed(values: NDArray) -> Any:
        entries = np.zeros(slice_offsets[-1])
        entries[place] = values
        return wp.array(entries, dtype=float, device=model.device)

    table = SpringTable()
    table.slice_offsets = wp.array(slice_offsets, dtype=wp.int32, device=model.device)
    table.valences = wp.array(valence, dtype=wp.int32, device=model.device)
    table.ends = wp.array(end, dtype=wp.int32, device=model.device)
    table.scales = placed(ends.scale) if ends.vary else wp.zeros(0, dtype=float, device=model.device)
    table.rest_lengths = placed(ends.scale * ends.rest_length)
    table.stiffness = model.stiffness
    table.viscosity = model.viscosity
    table.yield_stretch = model.yield_stretch
    table.limits = model.correction_limit
    table.hinges = hinge_table(model)
    table.yields_at_limit = model.scene.correction == "tarantino"
    return table


def hinge_table(model: Model) -> Any:
    """The hinges of balloons, where there are torsion springs, and the roles of each particle in them."""
    hinges = [shape.hinges for shape in model.shapes] if model_traits(model).torsion else []
    offsets = model.particle_offsets[:-1]
    empty = np.zeros(0, dtype=np.int64)
    ends = np.concatenate([empty.reshape(0, 2), *(h.ends + first for h, first in zip(hinges, offsets, strict=False))])
    wings = np.concatenate([empty, *(h.wing_particles + first for h, first in zip(hinges, offsets, strict=False))])
    sizes = np.concatenate([empty, *(h.wing_sizes.ravel() for h in hinges)])
    numbers = np.arange(len(ends))
    particles = np.concatenate([ends[:, 0], ends[:, 1], wings])
    of_wings = np.stack([4 * numbers + 2, 4 * numbers + 3], axis=1).ravel()
    roles = np.concatenate([4 * numbers, 4 * numbers + 1, np.repeat(of_wings, sizes)])
    order = np.lexsort([roles, particles])

    def array(values: NDArray, dtype: Any) -> Any:
        return wp.array(values, dtype=dtype, device=model.device)

    table = HingeTable()
    table.ends = array(ends, wp.vec2i)
    table.wing_offsets = array(np.cumsum(np.append(0, sizes)), wp.int32)
    table.wing_particles = array(wings, wp.int32)
    angles = [h.angles(shape.mesh.points) for h, shape in zip(hinges, model.shapes, strict=False)]
    table.rest_angles = array(np.concatenate([np.zeros(0), *angles]), float)
    table.particle_offsets = array(np.searchsorted(particles[order], np.arange(model.particle_count + 1)), wp.int32)
    table.particle_roles = array(roles[order], wp.int32)
    table.stiffness = model.torsion
    return table


def correction_table(model: Model) -> Any:
    """Springs color by color; none where lengths are not corrected."""
    corrected = model.scene.correction != "none"
    pairs = np.asarray(model.spring_particles.numpy(), dtype=np.int64).reshape(-1, 2)[: None if corrected else 0]
    colors = color_springs(pairs)
    order = np.lexsort([pairs[:, 1], pairs[:, 0], colors])
    table = CorrectionTable()
    table.color_offsets = wp.array(np.append(0, np.cumsum(np.bincount(colors))), dtype=wp.int32, device=model.device)
    table.particles = wp.array(pairs[order], dtype=wp.vec2i, device=model.device)
    table.rest_lengths = wp.array(model.spring_rest_length.numpy()[order], dtype=float, device=model.device)
    table.limits = model.correction_limit
    table.sweeps = model.scene.correction_sweeps
    return table


def string_table(model: Model) -> Any:
    """Strings by the particle that they hold."""
    held = model.string_particle.numpy()
    order = np.argsort(held, kind="stable")
    offsets = np.searchsorted(held[order], np.arange(model.particle_count + 1)) if len(held) else []
    table = StringTable()
    table.offsets = wp.array(np.array(offsets), dtype=wp.int32, device=model.device)
    table.particles = wp.array(held[order], dtype=wp.int32, device=model.device)
    table.order = wp.array(order, dtype=wp.int32, device=model.device)
    table.anchors = model.string_anchor
    table.lengths = model.string_length
    table.stiffness = model.string_stiffness
    return table


def body_table(model: Model, mass: wp.array | None = None) -> Any:
    """What pulls at each particle by itself; with other masses of balloons, those that it moves with."""
    table = BodyTable()
    table.balloon = model.particle_balloon
    table.mass_share = model.particle_mass_share
    table.mass = model.mass if mass is None else mass
    table.helium = model.helium
    table.damping = model.damping
    table.gravity = model.gravity
    table.up = model.up
    return table


def obstacle_table(model: Model) -> Any:
    """Spheres and ground."""
    table = ObstacleTable()
    table.sphere_mass = model.sphere_mass
    table.sphere_radius = model.sphere_radius
    table.sphere_penalty = model.sphere_penalty
    table.ground_height = model.ground_height
    table.ground_friction = model.ground_friction
    table.ground_restitution = model.ground_restitution
    return table


def water_table(model: Model) -> Any:
    """The liquid."""
    table = WaterTable()
    table.level = model.water_level
    table.density = model.water_density
    table.drag = model.water_drag
    return table


def face_table(model: Model) -> Any:
    """Faces, and the faces around each particle."""
    table = FaceTable()
    table.offsets = model.face_offsets
    table.particles = model.face_particles
    table.balloon = model.face_balloon
    face_counts = [shape.mesh.face_count for shape in model.shapes]
    table.balloon_offsets = wp.array(np.cumsum([0, *face_counts]), dtype=wp.int32, device=model.device)
    table.particle_offsets = model.particle_face_offsets
    table.around_particles = model.particle_faces
    return table


def air_table(model: Model) -> Any:
    """What fills balloons, and the air around them."""
    table = AirTable()
    table.kind = model.inflation_kind
    table.gamma = model.gamma
    table.molar_mass = model.molar_mass
    table.drag_coefficient = model.drag_coefficient
    table.pressure = model.air_pressure
    table.temperature = model.air_temperature
    table.density = model.air_density
    table.wind = model.wind
    table.tube_balloons = model.tube_balloons
    table.tube_conductance = model.tube_conductance
    table.balloon_particles = wp.array(model.particle_offsets, dtype=wp.int32, device=model.device)
    return table


def world_state(state: State) -> Any:
    """The arrays of a state."""
    worlds = WorldState()
    for name in WorldState.vars:
        setattr(worlds, name, getattr(state, name))
    return worlds
