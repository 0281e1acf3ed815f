"""Tables of the host's plan that the reference takes from a scene, and parameters in float64 without rounding."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from balloon_warp.kernels.laws.crushed import NO_INSIDE
from balloon_warp.kernels.laws.gusts import hashed, waves
from balloon_warp.mesh.corners import corner_faces, next_corners
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.model.acting import values_over_time
from balloon_warp.model.crushing import inside_volume, may_be_crushed
from balloon_warp.model.following import follow_changes
from balloon_warp.model.gas import pressure_bounds
from balloon_warp.model.obstacle_motion import obstacle_motion
from balloon_warp.model.plan import ModelPlan, plan_model, settled_parameters
from balloon_warp.model.rows import rows_of
from balloon_warp.model.starts import start_of
from balloon_warp.reference.laws import MEMBRANES
from balloon_warp.scene import Scene
from balloon_warp.springs.coloring import color_springs

Array = np.ndarray


def planned(scene: Scene, values: dict[str, float]) -> tuple[ModelPlan, dict[str, Array]]:
    """Return the plan of a scene, and its parameters where some values are others, by their paths."""
    changes = [change.model_copy(update={"set": dict(change.set)}) for change in scene.change]
    for path in [path for path in values if path.startswith("change.")]:
        which, inner = path.removeprefix("change.").split(".set.")
        changes[int(which)].set[inner] = values.pop(path)
    plan = plan_model(scene.model_copy(update={"change": changes}))
    return plan, settled_parameters(plan, {path: np.array([value]) for path, value in values.items()})


def changed(plan: ModelPlan, change: Any, before: dict[str, Array]) -> dict[str, Array]:
    """Return the parameters after a change that a scene plans, with their dependents."""
    after = before | {name: before[name].copy() for name in change.values}
    for name in change.values:
        change.apply(name, after[name])
    follow_changes(change.scene, plan.shapes, before, after)
    return after


def numbers(plan: ModelPlan, parameters: dict[str, Array], balloon: int) -> SimpleNamespace:
    """Return the parameters that a balloon sees by name: its own, and those of the world."""
    rows = [row for row in rows_of(plan.laws) if row.of in ("balloon", "world") and row.name in parameters]
    seen = {row.name: parameters[row.name][0] for row in rows}
    seen |= {row.name: seen[row.name][balloon] for row in rows if row.of == "balloon"}
    named = {name: float(np.ravel(value)[0]) if np.size(value) == 1 else value for name, value in seen.items()}
    return SimpleNamespace(**named | {"mass": float(parameters["mass"][0, balloon])})


def balloon_of(plan: ModelPlan, number: int) -> SimpleNamespace:
    """Return the tables of a balloon: springs, hinges, film, faces, and the neck."""
    shape, scene = plan.shapes[number], plan.scene
    count, mesh, springs, hinges = len(shape.mesh.points), shape.skin, shape.springs, shape.hinges
    of, corners = corner_faces(mesh), mesh.face_vertex_indices.astype(int)
    means = np.zeros((len(mesh.face_vertex_counts), count))
    np.add.at(means, (of, corners), 1.0 / mesh.face_vertex_counts[of])
    wings = np.zeros((2 * len(hinges.ends), count))
    sizes = np.diff(hinges.wing_offsets)
    np.add.at(wings, (np.repeat(np.arange(len(sizes)), sizes), hinges.wing_particles), 1.0 / np.repeat(sizes, sizes))
    lengths = np.float32(springs.rest_lengths).astype(float)
    order = np.lexsort([springs.pairs[:, 1], springs.pairs[:, 0], color_springs(springs.pairs, shape.mesh.points)])
    crushes = may_be_crushed(scene, plan.shapes, list(values_over_time(plan, "keyframe_values")))
    return SimpleNamespace(
        enclosed=inside_volume(shape) if crushes else NO_INSIDE,
        share=shape.mass_share, kind=scene.balloon[number].inflation.kind, neck=shape.neck,
        kinds=springs.kind, scales=shape.stiffness_scale, curve=scene.balloon[number].inflation.pump_curve,
        times=[time for time, _ in scene.balloon[number].inflation.keyframes],
        springs=SimpleNamespace(
            pairs=springs.pairs, lengths=lengths[:, None], constants=np.zeros((len(lengths), 1)),
            corrected=[(*springs.pairs[n], lengths[n]) for n in order],
        ),
        hinges=SimpleNamespace(
            ends=hinges.ends, first=wings[::2], second=wings[1::2], rest=hinges.angles(shape.mesh.points)[:, None]
        ),
        film=film_of(shape.membrane, scene.balloon[number].material.law), peak=np.zeros(shape.membrane.count),
        faces=SimpleNamespace(corners=corners, nexts=corners[next_corners(mesh)], of=of, means=means),
        volume=signed_volume(shape.mesh), bound=pressure_bounds(scene, plan.shapes)[number],
    )  # fmt: skip


def film_of(membrane: Any, law: str) -> SimpleNamespace | None:
    """Return triangles of a membrane with the inverse transposed of their flat edges; None for a balloon of springs."""
    if law not in MEMBRANES:
        return None
    first, second = membrane.edges[:, 0], membrane.edges[:, 1]
    along = first / np.linalg.norm(first, axis=1, keepdims=True)
    flat = np.einsum("tex,tfx->tef", membrane.edges, np.stack([along, across_of(along, second)], axis=1))
    inverse = np.linalg.inv(flat).transpose(0, 2, 1)
    return SimpleNamespace(corners=membrane.corners, areas=membrane.areas, inverse=inverse, energy=MEMBRANES[law])


def across_of(along: Array, second: Array) -> Array:
    across = second - (second * along).sum(axis=1, keepdims=True) * along
    return across / np.linalg.norm(across, axis=1, keepdims=True)


def waves_of(seed: int) -> SimpleNamespace:
    """Return the gusts' wave vectors, amplitudes and phases, which a seed draws."""
    vectors, amplitudes = np.array(waves(), dtype=np.float32).astype(float).transpose(1, 0, 2)
    phases = [(hashed(hashed((seed + hashed(number)) % 2**32)) >> 8) * 2.0**-24 for number in range(len(vectors))]
    return SimpleNamespace(vectors=vectors, amplitudes=amplitudes, phases=np.array(phases))


def obstacles_of(plan: ModelPlan) -> list[SimpleNamespace]:
    """Return obstacles: shapes, and places and turns by frame."""
    motion, up, found = obstacle_motion(plan.scene), np.array(plan.scene.up), []
    for number, shape in enumerate(plan.obstacles):
        x, y, z, w = motion[:, number, 3:].T
        turns = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                          [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                          [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])  # fmt: skip
        found.append(
            SimpleNamespace(shape=shape.kind, size=shape.size, thickness=shape.thickness, up=up,
                            shifts=motion[:, number, :3], turns=turns.transpose(2, 0, 1))
        )  # fmt: skip
    return found


def spheres_of(parameters: dict[str, Array]) -> list[dict[str, Any]]:
    """Return the spheres at the start."""
    starts = [parameters[f"initial_sphere_{name}"][0] for name in ("positions", "velocities", "spins")]
    return [{"position": x, "velocity": v, "spin": w, "force": np.zeros(3)} for x, v, w in zip(*starts, strict=True)]


def start_of_balloon(plan: ModelPlan, parameters: dict[str, Array], number: int) -> tuple[Array, Array]:
    """Return places and velocities at the start."""
    x = start_of(plan.scene, parameters, number, plan.shapes[number].mesh.points)[0]
    spin, center = (parameters[f"initial_{name}"][0, number] for name in ("spins", "centers"))
    return x, parameters["initial_velocities"][0, number] + np.cross(spin, x - center)
