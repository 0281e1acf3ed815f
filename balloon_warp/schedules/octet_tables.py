"""From a model to the tables of octets: eight particles, or faces, side by side."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes
from balloon_warp.kernels.octets_state import LaneNumbers, OctetFaces, OctetSprings
from balloon_warp.model import Model
from balloon_warp.schedules.tables import SpringEnds


def octet_count(members: int) -> int:
    """Octets that hold so many members."""
    return -(-members // LANE_COUNT)


def octet_springs(model: Model, ends: SpringEnds) -> Any:
    """The springs of eight particles at a time: the n-th of a kind at each."""
    octets = octet_count(model.particle_count)
    counts = np.zeros((LANE_COUNT * octets, 3), dtype=np.int64)
    counts[: model.particle_count] = ends.by_kind
    widths = counts.reshape(octets, LANE_COUNT, 3).max(axis=1)
    offsets = _offsets(widths.ravel())
    at_particle = 3 * ends.particle + ends.kind
    nth = np.arange(len(at_particle)) - np.searchsorted(at_particle, at_particle)
    octet, lane = np.divmod(ends.particle, LANE_COUNT)
    slot = offsets[3 * octet + ends.kind] + nth
    particles = np.minimum(np.arange(LANE_COUNT * octets), model.particle_count - 1)
    neighbors = np.repeat(particles.reshape(octets, LANE_COUNT), widths.sum(axis=1), axis=0)
    neighbors[slot, lane] = ends.neighbor

    def placed(values: NDArray) -> Any:
        lanes = np.zeros(neighbors.shape)
        lanes[slot, lane] = values
        return wp.array(lanes, dtype=Lanes, device=model.device)

    table = OctetSprings()
    table.offsets = wp.array(offsets[::3], dtype=wp.int32, device=model.device)
    table.kinds = wp.array(np.repeat(np.tile(range(3), octets), widths.ravel()), dtype=wp.int32, device=model.device)
    table.ends = wp.array(neighbors, dtype=LaneNumbers, device=model.device)
    table.scales = placed(ends.scale) if ends.vary else wp.zeros(0, dtype=Lanes, device=model.device)
    table.rest_lengths = placed(ends.scale * ends.rest_length)
    table.stiffness = model.stiffness
    return table


def face_octet_count(model: Model) -> int:
    """Octets that the faces take."""
    counts = np.unique(_balloons_and_corner_counts(model), axis=1, return_counts=True)[1]
    return sum(octet_count(count) for count in counts.tolist())


def octet_faces(model: Model) -> Any:
    """Eight faces at a time, of one balloon and with as many corners, and the faces around eight particles."""
    begins = np.asarray(model.face_offsets.numpy(), dtype=np.int64)
    particles = np.asarray(model.face_particles.numpy(), dtype=np.int64)
    alike = _balloons_and_corner_counts(model)
    places = np.zeros(model.face_count, dtype=np.int64)
    corners, corner_counts, balloons = [], [], []
    for balloon, corner_count in np.unique(alike, axis=1).T:
        faces = np.flatnonzero((alike == [[balloon], [corner_count]]).all(axis=0))
        octets = octet_count(len(faces))
        places[faces] = LANE_COUNT * len(balloons) + np.arange(len(faces))
        of_faces = np.zeros((LANE_COUNT * octets, corner_count), dtype=np.int64)
        of_faces[: len(faces)] = particles[begins[faces, None] + np.arange(corner_count)]
        corners.append(of_faces.reshape(octets, LANE_COUNT, corner_count).transpose(0, 2, 1).reshape(-1, LANE_COUNT))
        corner_counts += octets * [corner_count]
        balloons += octets * [balloon]
    around_offsets, around = _faces_around(model, places, nothing=LANE_COUNT * len(balloons))
    table = OctetFaces()
    table.offsets = wp.array(_offsets(np.array(corner_counts)), dtype=wp.int32, device=model.device)
    table.corners = wp.array(np.concatenate(corners), dtype=LaneNumbers, device=model.device)
    table.counting = wp.array(np.arange(max(corner_counts)), dtype=wp.int32, device=model.device)
    table.balloon = wp.array(balloons, dtype=wp.int32, device=model.device)
    table.around_offsets = wp.array(around_offsets, dtype=wp.int32, device=model.device)
    table.around = wp.array(around, dtype=LaneNumbers, device=model.device)
    return table


def _balloons_and_corner_counts(model: Model) -> NDArray[np.int64]:
    """Of each face, shape (2, face_count)."""
    return np.stack([model.face_balloon.numpy(), np.diff(model.face_offsets.numpy())]).astype(np.int64)


def _faces_around(model: Model, places: NDArray, nothing: int) -> tuple[NDArray, NDArray]:
    """Where the faces around each octet of particles begin, and their places; `nothing` is that of a face which is far
    away."""
    begins = np.asarray(model.particle_face_offsets.numpy(), dtype=np.int64)
    octets = octet_count(model.particle_count)
    counts = np.zeros(LANE_COUNT * octets, dtype=np.int64)
    counts[: model.particle_count] = np.diff(begins)
    widths = counts.reshape(octets, LANE_COUNT).max(axis=1)
    offsets = _offsets(widths)
    particle = np.repeat(np.arange(model.particle_count), np.diff(begins))
    octet, lane = np.divmod(particle, LANE_COUNT)
    faces = np.asarray(model.particle_faces.numpy(), dtype=np.int64)
    around = np.full((offsets[-1], LANE_COUNT), nothing)
    around[offsets[octet] + np.arange(len(particle)) - begins[particle], lane] = places[faces]
    return offsets, around


def _offsets(counts: NDArray) -> NDArray:
    return np.append(0, np.cumsum(counts))
