"""Causes of many substeps of a mesh by itself, and their remedies."""

from collections.abc import Sequence

import numpy as np

from balloon_warp.mesh.topology import mesh_edges, vertex_components
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.strung import constants_of
from balloon_warp.scene import Scene
from balloon_warp.springs.even import film_tension

MANY = 30
"""Number of substeps of a frame up to which nothing needs to be said"""
USUAL_PARTICLES, USUAL_MASS, USUAL_SUM = 2000.0, 2.0, 3.0
"""Number of particles, mass [kg], and sum of a particle's springs over the skin's tension, of a mesh that takes 14"""


def many_substeps_said(scene: Scene, shapes: Sequence[BalloonShape], substeps: int) -> str | None:
    """Return a sentence on the cause of a short step of one balloon of even springs, and its remedy; else None.

    Masses lie where springs are stiff, so that the frequency squared goes with the sum of all constants over the mass.
    So one of these is unusual: the number of particles, the mass, or springs of a kind.

    Args:
        substeps: in a frame.
    """
    if substeps <= MANY or len(shapes) != 1 or not scene.balloon[0].stiffness.even:
        return None
    shape, mass, constants = shapes[0], scene.balloon[0].mass, constants_of(scene.balloon[0].stiffness)
    tension = film_tension(constants)
    if shape.membrane.count or not tension or not mass:
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
