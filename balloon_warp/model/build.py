"""Building the model on a device from a scene."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from balloon_warp.device import pick_device
from balloon_warp.driver import begin_driver
from balloon_warp.kernels.frame import place_balloons
from balloon_warp.kernels.laws import Law
from balloon_warp.launching import begin_loading
from balloon_warp.model.model import Model
from balloon_warp.model.obstacles import obstacle_motion, warp_mesh
from balloon_warp.model.parameters import all_columns, pack, views_of
from balloon_warp.model.plan import ModelPlan, plan_model
from balloon_warp.model.ridges import ridge_tree
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.strings import Carriers
from balloon_warp.model.vary import Vary
from balloon_warp.scene import Scene

KINDS = ("normal_force", "pressure", "gas")
"""Kinds of inflation, as the kernels number them"""
DTYPES: dict[str, Any] = {
    **dict.fromkeys(
        ("initial_sphere_positions", "initial_sphere_velocities", "initial_sphere_spins", "initial_spins"), wp.vec3
    ),
    **dict.fromkeys(("initial_velocities", "string_anchor", "obstacle_position", "force_newtons"), wp.vec3),
    **dict.fromkeys(("initial_body_positions", "initial_body_velocities", "initial_body_spins"), wp.vec3),
    **dict.fromkeys(("initial_shifts", "initial_centers"), wp.vec3d),
    "initial_turns": wp.mat33d,
    "initial_loads": wp.vec2,
    **dict.fromkeys(("initial_gas_amounts", "initial_free_volumes"), wp.float64),
}
"""Types of the parameters that no law has; others are float32"""


def build_model(
    scene: Scene,
    device: str | wp.Device | None = None,
    world_count: int = 1,
    vary: Vary | None = None,
    laws: Sequence[Law] = (),
) -> Model:
    """Read the scene's meshes, string them, and lay everything out on the device.

    Raises:
        InputError: as `plan_model`.
    """
    device = pick_device(device)
    begin_driver(str(device))
    begin_loading(place_balloons, device)
    return lay_out(plan_model(scene, world_count, vary, laws=laws), device)


def lay_out(plan: ModelPlan, device: str | wp.Device | None = None) -> Model:
    """Return the planned model on a device. Large arrays are in states and schedules."""
    device = pick_device(device)
    scene, shapes = plan.scene, plan.shapes
    offsets = np.cumsum([0] + [shape.mesh.vertex_count for shape in shapes])

    def array(data: ArrayLike, dtype: Any) -> Any:
        return wp.array(np.asarray(data), dtype=dtype, device=device)

    def joined(parts: Sequence[ArrayLike], dtype: Any) -> Any:
        return array(np.concatenate([np.asarray(part) for part in parts]), dtype)

    def of_particles(parts: Sequence[NDArray[Any]], dtype: Any) -> Any:
        """Join arrays that number the particles of each balloon from 0."""
        return joined([part + offset for part, offset in zip(parts, offsets, strict=False)], dtype)

    skins = [shape.skin for shape in shapes]
    face_sizes = np.concatenate([skin.face_vertex_counts for skin in skins])
    face_particles = np.concatenate(
        [skin.face_vertex_indices + offset for skin, offset in zip(skins, offsets, strict=False)]
    )
    incidence_offsets, incident_faces = _faces_around_particles(face_sizes, face_particles, int(offsets[-1]))
    columns = all_columns(plan.laws)
    packed = pack(columns, plan.parameters, device)
    views = views_of(columns, **packed)
    others = {
        name: _items(values, DTYPES.get(name, wp.float32), device)
        for name, values in plan.parameters.items()
        if name not in views
    }
    return Model(
        scene=scene,
        shapes=shapes,
        particle_offsets=offsets.tolist(),
        device=device,
        world_count=plan.world_count,
        substeps=plan.substeps,
        due_changes=plan.due_changes,
        laws=plan.laws,
        warnings=plan.warnings,
        strain_bound=plan.strain_bound,
        frame_seconds=1.0 / scene.frames_per_second,
        up=wp.vec3(*scene.up),
        initial_points=array(np.concatenate([shape.mesh.points for shape in shapes]), wp.vec3d),
        balloon_origins=array([balloon.position for balloon in scene.balloon], wp.vec3d),
        particle_balloon=array(np.repeat(np.arange(len(shapes)), np.diff(offsets)), wp.int32),
        particle_mass_share=joined([shape.mass_share for shape in shapes], float),
        particle_face_offsets=array(incidence_offsets, wp.int32),
        particle_faces=array(incident_faces, wp.int32),
        face_offsets=array(np.cumsum(np.append(0, face_sizes)), wp.int32),
        face_particles=array(face_particles, wp.int32),
        face_balloon=array(np.repeat(np.arange(len(shapes)), [shape.mesh.face_count for shape in shapes]), wp.int32),
        spring_particles=of_particles([shape.springs.pairs for shape in shapes], wp.vec2i),
        spring_kind=joined([shape.springs.kind for shape in shapes], wp.int32),
        spring_rest_length=joined([shape.springs.rest_lengths for shape in shapes], float),
        spring_stiffness_scale=joined([shape.stiffness_scale for shape in shapes], float),
        membrane_corners=of_particles([shape.membrane.corners for shape in shapes], wp.vec3i),
        membrane_rests=joined([shape.membrane.rests for shape in shapes], wp.vec4),
        keyframe_times=array(_keyframe_times(scene), float),
        inflation_kind=array([KINDS.index(balloon.inflation.kind) for balloon in scene.balloon], wp.int32),
        tube_balloons=array(np.array([tube.balloons for tube in scene.tube]).reshape(-1, 2), wp.vec2i),
        neck_weights=joined(_neck_weights(shapes), float),
        neck_offsets=array(np.cumsum([0, *(len(shape.neck.edges) for shape in shapes)]), wp.int32),
        neck_edges=of_particles([shape.neck.edges for shape in shapes], wp.vec2i),
        string_particle=array([p + offsets[s.balloon] for s, p in zip(scene.string, plan.held, strict=True)], wp.int32),
        **_carried(Carriers.of(scene, plan.bodies), device),
        driven=plan.driven,
        obstacles=plan.obstacles,
        obstacle_meshes=[warp_mesh(shape, device) for shape in plan.obstacles],
        bodies=plan.bodies,
        body_meshes=[warp_mesh(shape.solid, device) for shape in plan.bodies],
        ridges=plan.ridges,
        ridge_trees=[ridge_tree(ridges, device) for ridges in plan.ridges],
        obstacle_motion=_items(obstacle_motion(scene), wp.transform, device),
        columns=columns,
        balloon_numbers=packed["balloon_numbers"],
        sphere_numbers=packed["sphere_numbers"],
        world_numbers=packed["world_numbers"],
        parameters={**views, **others},
    )


def _carried(carriers: Carriers, device: wp.Device) -> dict[str, Any]:
    """Return the carriers of strings' anchors, on the host and as arrays."""
    numbers = np.stack([carriers.obstacles, carriers.bodies], axis=1)
    return {
        "carriers": carriers,
        "string_carriers": wp.array(numbers, dtype=wp.vec2i, device=device),
        "string_centers": wp.array(carriers.centers, dtype=wp.vec3, device=device),
        "anchor_motion": _items(carriers.motion, wp.transform, device),
    }


def _neck_weights(shapes: Sequence[BalloonShape]) -> list[NDArray[np.float64]]:
    """Return the neck weights of all particles, or of none where no balloon has a neck."""
    if not any(len(shape.neck.edges) for shape in shapes):
        return [np.zeros(0)]
    return [shape.neck.weights if len(shape.neck.edges) else np.zeros(shape.mesh.vertex_count) for shape in shapes]


def _items(values: NDArray[np.float64], dtype: Any, device: wp.Device) -> wp.array:
    """Return an array of numbers, of vectors of the last dimension, or of matrices of the last two."""
    if dtype in (wp.float32, wp.float64, wp.mat33d):
        return wp.array(values, dtype=dtype, device=device)
    flat = values.reshape(-1, values.shape[-1])  # Warp does not tell an empty array's last dimension
    return wp.array(flat, dtype=dtype, device=device).reshape(values.shape[:-1])


def _keyframe_times(scene: Scene) -> NDArray[np.float64]:
    """Return the times of all keyframes, shape (balloon_count, keyframe_count), padded by the last."""
    lists = [[time for time, _ in balloon.inflation.keyframes] for balloon in scene.balloon]
    longest = max(len(times) for times in lists)
    return np.array([times + times[-1:] * (longest - len(times)) for times in lists])


def _faces_around_particles(
    face_sizes: NDArray[np.int32], face_particles: NDArray[np.int32], particle_count: int
) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Return the faces of each particle, as offsets and a flat list.

    A face that passes a particle twice counts once.
    """
    faces = np.repeat(np.arange(len(face_sizes)), face_sizes)
    pairs = np.unique(np.stack([face_particles, faces], axis=1), axis=0)
    return np.searchsorted(pairs[:, 0], np.arange(particle_count + 1)), pairs[:, 1]
