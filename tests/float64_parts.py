"""Parts of a motion in NumPy and double precision that know no balloon: water, gusts, obstacles."""

from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from balloon_warp.kernels.laws.gusts import hashed, waves

Array = np.ndarray


def wet_integrals(depths: Array) -> tuple[Array, Array]:
    """Return the means over a triangle of depth times barycentric coordinate, and of the coordinate, where the depth is
    positive.

    They are exact integrals of a polynomial over the wet polygon, cut into triangles."""
    corners = np.eye(3)
    polygon = []
    for a, b, first, second in zip(corners, np.roll(corners, -1, axis=0), depths, np.roll(depths, -1), strict=True):
        polygon += [a] if first > 0.0 else []
        polygon += [a + first / (first - second) * (b - a)] if first * second < 0.0 else []
    moments, areas = np.zeros(3), np.zeros(3)
    for second, third in pairwise(polygon[1:]):
        piece = np.array([polygon[0], second, third])
        part, here = abs(np.linalg.det(piece)), piece @ depths
        areas += part * piece.mean(axis=0)
        moments += part * (here.sum() * piece.sum(axis=0) + here @ piece) / 12.0
    return moments, areas


VECTORS, AMPLITUDES = np.array(waves(), dtype=np.float32).astype(float).transpose(1, 0, 2)
PHASES = np.array([(hashed(hashed(hashed(number))) >> 8) * 2.0**-24 for number in range(len(VECTORS))])


def gusts(place: Array) -> Array:
    """Return the sum of all waves of seed 0, each about a sine."""
    turns = place @ VECTORS.T + PHASES
    part = turns - np.floor(turns) - 0.5
    arch = part * (16.0 * np.abs(part) - 8.0)
    return (arch * (0.775 + 0.225 * np.abs(arch))) @ AMPLITUDES


NEAR = 2e-6
"""Of a way: what float32 does not tell, and obstacles forgive"""


def let_through(obstacle: Any, start: Array, x: Array) -> tuple[Array, Array, Array, Array]:
    """Return the stopped particles, the places and normals there, and the remaining part of each path.

    A path that enters a plane from beside it is stopped at the entry, and slides on along the plane."""
    way = np.linalg.norm(x - start, axis=1, keepdims=True)
    ahead, near = (
        (x - start) / np.maximum(way, 1e-30),
        NEAR * (way + np.linalg.norm(start - obstacle.position, axis=1, keepdims=True)),
    )
    distance, normal = surface(obstacle, x)
    if not (distance < 0.0).any():
        return distance < 0.0, x, normal, np.ones_like(way)
    slides = ((start - x) * normal).sum(axis=1, keepdims=True) + distance < -near
    gone, open_ways = np.zeros_like(way), np.ones_like(way, dtype=bool)
    for _ in range(32):
        here, out = surface(obstacle, start + gone * ahead)
        falling = -(out * ahead).sum(axis=1, keepdims=True)
        falling = np.where(falling == 0.0, 1e-30, falling)
        further = np.minimum(gone + (np.maximum(here, 0.0) + 4.0 * near) / falling, way)
        deep = surface(obstacle, start + further * ahead)[0] < -near
        step = np.where(here > near, gone + here / falling, further)
        open_ways &= (here > near) | ~((here < -near) | deep)
        before, gone = gone, np.where(open_ways & slides, np.clip(step, 0.0, way), gone)
        if (gone == before).all():
            break  # no further step would change it
    here, out = surface(obstacle, start + gone * ahead)
    place = start + gone * ahead - here * out
    slid = x + np.maximum(((place - x) * out).sum(axis=1, keepdims=True), 0.0) * out
    left = np.where(slides, 1.0 - gone / np.maximum(way, 1e-30), 1.0)
    return distance < 0.0, np.where(slides, slid, x - distance * normal), np.where(slides, out, normal), left


def surface(obstacle: Any, x: Array) -> tuple[Array, Array]:
    """Return the signed distance of a box, capsule or plane at rest, with the y axis up, and its normal."""
    turn = Rotation.from_euler("xyz", obstacle.rotation, degrees=True)
    here = turn.inv().apply(x - np.array(obstacle.position))
    if obstacle.shape == "plane":
        distance, normal = here[:, 1], np.broadcast_to((0.0, 1.0, 0.0), x.shape)
    elif obstacle.shape == "capsule":
        height = np.clip(here[:, 1], -0.5 * obstacle.length, 0.5 * obstacle.length)
        arm = here - height[:, None] * (0.0, 1.0, 0.0)
        distance, normal = np.linalg.norm(arm, axis=1) - obstacle.radius, arm
    else:
        beyond = np.abs(here) - 0.5 * np.array(obstacle.size)
        inside = beyond * (beyond == beyond.max(axis=1, keepdims=True))
        is_out = beyond.max(axis=1, keepdims=True) > 0.0
        distance = np.where(is_out[:, 0], np.linalg.norm(np.maximum(beyond, 0.0), axis=1), beyond.max(axis=1))
        normal = np.where(is_out, np.maximum(beyond, 0.0), -inside) * np.sign(here)
    distance = distance[:, None] - (obstacle.thickness or 0.0)
    return distance, turn.apply(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300))


def rolled(sphere: dict[str, Any], up: Array, h: float, gravity: float, height: float, restitution: float) -> None:
    """Advance a sphere by a step: under its force, and rolling on the ground as a solid ball."""
    v = sphere["velocities"] + h * (sphere["force"] / sphere["mass"] - gravity * up)
    x, w, radius = sphere["positions"] + h * v, sphere["spins"], sphere["radius"]
    depth = height + radius - x @ up
    if depth > 0.0:
        x = x + depth * up
        stopped = (1.0 + restitution) * max(-(v @ up), 0.0)
        v = v + stopped * up
        slip = v + np.cross(w, -radius * up)
        slip = slip - (slip @ up) * up
        part = min(2.0 / 7.0, sphere["friction"] * stopped / np.linalg.norm(slip))
        w = w + 2.5 / radius**2 * np.cross(-radius * up, -part * slip)
        v, x = v - part * slip, x - h * part * slip
    sphere |= {"positions": x, "velocities": v, "spins": w, "force": np.zeros(3)}


def out_of_sphere(sphere: dict[str, Any], x: Array, v: Array) -> tuple[Array, Array, Array]:
    """Return places and velocities projected out of a sphere, and the normals of those that were in it."""
    arm = x - sphere["positions"]
    distance = np.linalg.norm(arm, axis=1, keepdims=True)
    outward = np.where(distance < sphere["radius"], arm / distance, 0.0)
    approach = ((v - sphere["velocities"]) * outward).sum(axis=1, keepdims=True)
    place = np.where(distance < sphere["radius"], sphere["positions"] + sphere["radius"] * outward, x)
    return place, v - np.minimum(approach, 0.0) * outward, outward


def directions(mesh: Any, x: Array) -> Array:
    """Return the paper's (A_p / A_total) n of the face whose center is nearest, and the mean of the unit normals."""
    normals, nearest, areas, total = np.zeros_like(x), np.full(len(x), np.inf), np.zeros(len(x)), 0.0
    for corners in np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1]):
        center = x[corners].mean(axis=0)
        area = 0.5 * np.cross(x[corners] - center, np.roll(x[corners], -1, axis=0) - center).sum(axis=0)
        size = np.linalg.norm(area)
        normals[corners] += area / size
        distance = np.linalg.norm(x[corners] - center, axis=1)
        nearer = distance < nearest[corners]
        nearest[corners[nearer]], areas[corners[nearer]], total = distance[nearer], size, total + size
    return (areas / total)[:, None] * normals / np.linalg.norm(normals, axis=1, keepdims=True)


def thrusts(x: Array, neck: Any, opening: float, pressures: Array) -> Array:
    """Return the thrust of a jet: 2 C_d A p in shares, against the area vector that the neck's edges enclose."""
    first, second = (x[neck.edges[:, end]] for end in (0, 1))
    out = np.cross(first, second).sum(axis=0)
    return -(neck.weights * 2.0 * opening * np.maximum(pressures, 0.0))[:, None] * out / np.linalg.norm(out)


def torsion(shape: Any, constant: float, x: Array) -> Array:
    """Return torsional forces: the constant times the angle beyond that at rest, along the normals at the wings."""
    hinges = shape.hinges
    edge, first, second = hinges.arms(x)
    rest = hinges.angles(shape.mesh.points)
    moments = constant * ((hinges.angles(x) - rest + np.pi) % (2.0 * np.pi) - np.pi)
    lengths, force = np.linalg.norm(edge, axis=1), np.zeros_like(x)
    for number, wing in enumerate((first, second)):
        normal = np.cross(edge, wing) * (1.0, -1.0)[number]
        push = normal * (moments * lengths / (normal**2).sum(axis=1))[:, None]
        along = ((wing * edge).sum(axis=1) / lengths**2)[:, None]
        np.add.at(force, hinges.ends[:, 0], -(1.0 - along) * push)
        np.add.at(force, hinges.ends[:, 1], -along * push)
        for hinge, begin in enumerate(hinges.wing_offsets[number:-1:2]):
            size = hinges.wing_sizes[hinge, number]
            np.add.at(force, hinges.wing_particles[begin : begin + size], push[hinge] / size)
    return force


def water(
    mesh: Any, x: Array, v: Array, gain: Array, up: Array, gravity: float, level: float, density: float, drag: float
) -> Array:
    """Return hydrostatic pressure and drag on the wetted part of the fan of triangles about each face's center."""
    loads, wet = np.zeros_like(x), np.zeros(len(x))
    for corners in np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1]):
        center, size = x[corners].mean(axis=0), len(corners)
        for p, q in zip(corners, np.roll(corners, -1), strict=True):
            triangle = np.array([x[p], x[q], center])
            area = 0.5 * np.cross(triangle[0] - center, triangle[1] - center)
            moments, shares = wet_integrals(level - triangle @ up)
            shares *= np.linalg.norm(area)
            for each, corner in enumerate((p, q)):
                loads[corner] += moments[each] * area
                wet[corner] += shares[each]
            loads[corners] += moments[2] / size * area
            wet[corners] += shares[2] / size
    resistance = 0.5 * density * drag * wet * np.linalg.norm(v, axis=1)
    slowed = 1.0 + resistance * gain
    return -density * gravity * loads - (resistance / slowed)[:, None] * v


def air_on_faces(mesh: Any, x: Array, v: Array, wind: Any, air: float, drag: float, friction: float) -> Array:
    """Return the air's push on faces, shared by their corners; `wind` tells it at places."""
    force = np.zeros_like(x)
    faces = np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1])
    winds = iter(wind(np.array([x[corners].mean(axis=0) for corners in faces])))
    for corners in faces:
        area = 0.5 * np.cross(x[corners], np.roll(x[corners], -1, axis=0)).sum(axis=0)
        beside = v[corners].mean(axis=0) - next(winds)
        normal = area / np.linalg.norm(area)
        across = (beside @ normal) * normal
        push = drag * across + friction * (beside - across)
        force[corners] -= 0.5 * air * np.linalg.norm(area) * np.linalg.norm(beside) * push / len(corners)
    return force
