"""From a scene to the model on a device."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from balloon_warp.errors import InputError
from balloon_warp.model.model import Model
from balloon_warp.model.shape import BalloonShape, shape_balloon
from balloon_warp.model.stability import choose_substeps, stable_step
from balloon_warp.scene import Scene, String


def build_model(scene: Scene, device: wp.DeviceLike = None, world_count: int = 1) -> Model:
    """Read the scene's meshes, string them, and lay everything out on the device.

    Raises:
        InputError: a mesh cannot be read or strung, a particle is not in its balloon, or the step is not stable.
    """
    device = wp.get_device(device)
    shapes = [shape_balloon(balloon, scene) for balloon in scene.balloon]
    held = [_held_particle(number, string, scene, shapes) for number, string in enumerate(scene.string)]
    offsets = np.cumsum([0] + [shape.mesh.vertex_count for shape in shapes])
    times, values = _keyframe_table(scene)

    def array(data: ArrayLike, dtype: Any) -> Any:
        return wp.array(np.asarray(data), dtype=dtype, device=device)

    def joined(parts: Sequence[ArrayLike], dtype: Any) -> Any:
        return array(np.concatenate([np.asarray(part) for part in parts]), dtype)

    def per_balloon(values: Sequence[Any]) -> Any:
        return array([values], float)

    def per_sphere(field: str) -> Any:
        return array(np.array([[getattr(sphere, field) for sphere in scene.sphere]]), float)

    def vectors(rows: Sequence[Any]) -> Any:
        return array(np.array(rows).reshape(-1, 3), wp.vec3)

    face_sizes = np.concatenate([shape.mesh.face_vertex_counts for shape in shapes])
    face_particles = np.concatenate(
        [shape.mesh.face_vertex_indices + offset for shape, offset in zip(shapes, offsets, strict=False)]
    )
    incidence_offsets, incident_faces = _faces_around_particles(face_sizes, face_particles, int(offsets[-1]))
    return Model(
        scene=scene,
        shapes=shapes,
        particle_offsets=offsets.tolist(),
        device=device,
        world_count=world_count,
        substeps=choose_substeps(scene, stable_step(scene, shapes, held)),
        frame_seconds=1.0 / scene.frames_per_second,
        up=wp.vec3(*scene.up),
        initial_points=array(np.concatenate([shape.mesh.points for shape in shapes])[None], wp.vec3),
        particle_balloon=array(np.repeat(np.arange(len(shapes)), np.diff(offsets)), wp.int32),
        particle_mass_share=joined([shape.mass_share for shape in shapes], float),
        particle_face_offsets=array(incidence_offsets, wp.int32),
        particle_faces=array(incident_faces, wp.int32),
        face_offsets=array(np.cumsum(np.append(0, face_sizes)), wp.int32),
        face_particles=array(face_particles, wp.int32),
        face_balloon=array(np.repeat(np.arange(len(shapes)), [shape.mesh.face_count for shape in shapes]), wp.int32),
        spring_particles=joined(
            [shape.springs.pairs + offset for shape, offset in zip(shapes, offsets, strict=False)], wp.vec2i
        ),
        spring_kind=joined([shape.springs.kind for shape in shapes], wp.int32),
        spring_rest_length=joined([shape.springs.rest_lengths for shape in shapes], float),
        spring_stiffness_scale=joined([shape.stiffness_scale for shape in shapes], float),
        stiffness=per_balloon(
            [
                (balloon.stiffness.structural, balloon.stiffness.shear, balloon.stiffness.flexion)
                for balloon in scene.balloon
            ]
        ),
        mass=per_balloon([balloon.mass for balloon in scene.balloon]),
        helium=per_balloon([balloon.helium for balloon in scene.balloon]),
        damping=per_balloon([balloon.damping for balloon in scene.balloon]),
        keyframe_times=array(times, float),
        keyframe_values=array(values[None], float),
        initial_sphere_positions=vectors([sphere.position for sphere in scene.sphere]).reshape((1, -1)),
        initial_sphere_velocities=vectors([sphere.velocity for sphere in scene.sphere]).reshape((1, -1)),
        sphere_mass=per_sphere("mass"),
        sphere_radius=per_sphere("radius"),
        sphere_penalty=per_sphere("penalty"),
        string_particle=array(
            [particle + offsets[string.balloon] for string, particle in zip(scene.string, held, strict=True)], wp.int32
        ),
        string_anchor=vectors([string.anchor for string in scene.string]),
        string_length=array(
            np.array([_string_length(s, p, shapes) for s, p in zip(scene.string, held, strict=True)]).reshape(1, -1),
            float,
        ),
        string_stiffness=array(np.array([string.stiffness for string in scene.string]).reshape(1, -1), float),
        gravity=array([scene.gravity], float),
        ground_height=scene.ground.height if scene.ground else -np.inf,
        ground_friction=scene.ground.friction if scene.ground else 0.0,
        ground_restitution=scene.ground.restitution if scene.ground else 0.0,
    )


def _held_particle(number: int, string: String, scene: Scene, shapes: Sequence[BalloonShape]) -> int:
    """The particle that a string holds, numbered within its balloon."""
    mesh = shapes[string.balloon].mesh
    if isinstance(string.particle, str):
        used = np.unique(mesh.face_vertex_indices)
        heights = mesh.points[used] @ np.array(scene.up)
        return int(used[heights.argmax() if string.particle == "highest" else heights.argmin()])
    if string.particle >= mesh.vertex_count:
        raise InputError(
            f"string.{number}.particle: {mesh.name} has particles 0 to {mesh.vertex_count - 1} (got {string.particle})"
        )
    return string.particle


def _string_length(string: String, particle: int, shapes: Sequence[BalloonShape]) -> float:
    at_start = shapes[string.balloon].mesh.points[particle] - np.array(string.anchor)
    return string.length or float(np.linalg.norm(at_start))


def _keyframe_table(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times and values of all keyframes, each of shape (balloon_count, keyframe_count), padded by the last."""
    lists = [balloon.inflation.keyframes for balloon in scene.balloon]
    longest = max(len(keys) for keys in lists)
    table = np.array([keys + keys[-1:] * (longest - len(keys)) for keys in lists])
    return table[..., 0], table[..., 1]


def _faces_around_particles(
    face_sizes: NDArray[np.int32], face_particles: NDArray[np.int32], particle_count: int
) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """The faces of each particle, as offsets and a flat list; a face that passes a particle twice counts once."""
    faces = np.repeat(np.arange(len(face_sizes)), face_sizes)
    pairs = np.unique(np.stack([face_particles, faces], axis=1), axis=0)
    return np.searchsorted(pairs[:, 0], np.arange(particle_count + 1)), pairs[:, 1]
