"""Advice on a mesh by itself: causes of many substeps, and faces that show, with their remedies."""

from collections.abc import Sequence

import numpy as np

from balloon_warp.mesh.seams import size_of
from balloon_warp.mesh.topology import face_areas, mesh_edges, vertex_components
from balloon_warp.model.plan import plan_model
from balloon_warp.model.shape import BalloonShape, constants_of
from balloon_warp.scene import Scene, load_scene
from balloon_warp.springs.even import film_tension

MANY = 30
"""Number of substeps of a frame up to which nothing needs to be said"""
USUAL_PARTICLES, USUAL_MASS, USUAL_SUM = 2000.0, 2.0, 3.0
"""Number of particles, mass [kg], and sum of a particle's springs over the skin's tension, of a mesh that takes 14"""
FEW_PARTICLES = 300
"""Number of particles below which a balloon shows its faces"""
LARGE_FACE = 0.1
"""Root of a face's area over the balloon's size above which the face shows"""
OF_FILE = ("prim", "weld", "holes", "parts", "taken", "unit", "up", "scale")
"""Fields of a balloon from which the springs of a mesh by itself follow"""


def coarse_sentence(scene: Scene, shapes: Sequence[BalloonShape]) -> str | None:
    """Return a sentence on a mesh by itself whose faces show, and its remedy; else None."""
    if len(shapes) != 1 or not scene.balloon[0].stiffness.even:
        return None
    mesh = shapes[0].mesh
    largest = float(face_areas(mesh).max()) ** 0.5 / size_of(mesh)
    if mesh.vertex_count >= FEW_PARTICLES and largest <= LARGE_FACE:
        return None
    faces = f"{mesh.vertex_count:,} particles, faces up to {largest:.2g} of its size"
    helps = "balloon-warp remesh --cells 32 makes them small and even"
    return f"{shapes[0].name} is coarse and shows its faces ({faces}): {helps}"


def many_substeps_sentence(scene: Scene, shapes: Sequence[BalloonShape], substeps: int) -> str | None:
    """Return a sentence on the cause of a short step of a mesh by itself, and its remedy; else None.

    Masses lie where springs are stiff, so that the frequency squared goes with the sum of all constants over the mass.
    So one of these is unusual: the number of particles, the mass, or springs of a kind.

    Args:
        substeps: in a frame.
    """
    if substeps <= MANY or len(shapes) != 1 or not scene.balloon[0].stiffness.even:
        return None
    if scene.balloon[0].material.is_membrane:
        return _membrane_sentence(scene, substeps)
    shape, mass, constants = shapes[0], scene.balloon[0].mass, constants_of(scene.balloon[0].stiffness)
    tension = film_tension(constants)
    if not tension or not mass:
        return None
    each = constants[shape.springs.kind] * shape.stiffness_scale
    parts = vertex_components(shape.mesh, mesh_edges(shape.mesh))
    across = np.zeros(shape.springs.count, dtype=bool) if shape.across is None else shape.across
    between = ~across & (parts[shape.springs.pairs[:, 0]] != parts[shape.springs.pairs[:, 1]])
    surface = max(float(each[~across & ~between].sum()), 1e-30)
    count = max(int(np.count_nonzero(shape.mass_share)), 1)
    unusual = {
        f"it has {count:,} particles; remesh with fewer --cells helps": count / USUAL_PARTICLES,
        f"its mass of {mass:.3g} kg is small for its springs; more balloon.mass helps": USUAL_MASS / mass,
        "its narrow faces have stiff springs; remesh helps": 2.0 * surface / count / tension / USUAL_SUM,
        'springs across its thin walls are stiff; balloon.stiffness.thin = "alike" or remesh helps': (
            1.0 + float(each[across].sum()) / surface
        ),
        'its parts are tied by stiff springs; balloon.parts = "free" or remesh helps': (
            1.0 + float(each[between].sum()) / surface
        ),
    }
    return f"A frame takes {substeps:,} substeps, since {max(unusual, key=lambda why: unusual[why])}"


def _membrane_sentence(scene: Scene, substeps: int) -> str | None:
    """Compare the step of rubber or film with that of the springs which the mesh would have by itself."""
    (balloon,) = scene.balloon
    kept = {f"balloon.{field}": getattr(balloon, field) for field in OF_FILE if field in balloon.model_fields_set}
    springs = plan_model(load_scene(balloon.mesh, {**kept, "frames_per_second": scene.frames_per_second})).substeps
    if substeps <= springs:
        return None
    material = balloon.material.preset or balloon.material.kind
    return (
        f"A frame takes {substeps:,} substeps, since {material} is stiff for its mass: springs take {springs:,}; "
        'balloon.material.kind = "springs" or remesh with fewer --cells helps'
    )
