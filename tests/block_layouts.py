"""Block layouts that only a GPU chooses by itself, for a CPU, where a block is one thread."""

from collections.abc import Callable

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.membranes import MembraneFaceLayout
from balloon_warp.kernels.schedules.block_names import Layout
from balloon_warp.model import Model
from balloon_warp.schedules.membranes import membrane_face_entries, membrane_face_layout
from balloon_warp.schedules.slices import kind_slots, min_valence, quad_rings, spring_ends


def membrane_face_of(model: Model, features: Features, held: bool) -> MembraneFaceLayout | None:
    membrane_face = membrane_face_layout(model, features)
    if membrane_face is None or not held:
        return membrane_face._replace(areas=False) if membrane_face else None
    membrane_face = membrane_face._replace(capacity=model.particle_count)
    return membrane_face._replace(tile=membrane_face_entries(model, membrane_face))


def looped(*tiles: str) -> Callable[[Model, Features], Layout]:
    def layout(model: Model, features: Features) -> Layout:
        kept = () if features.reads_neighbor_velocities or features.impulses else ("velocity",)
        odd, membrane_face = model.substeps % 2 == 1, membrane_face_of(model, features, False)
        return Layout(
            1, model.particle_count, tiles=(*kept, *tiles) if tiles else (), odd=odd, membrane_face=membrane_face
        )

    return layout


def ordered(model: Model, features: Features) -> Layout:
    layout = looped("area_vector", "free_velocity")(model, features)
    return layout._replace(ordered="velocity" in layout.tiles and not (features.membranes or features.keeps))


def held(model: Model, features: Features) -> Layout:
    ring = quad_rings(model) if features.measures_areas or features.directions_on_the_way else None
    return Layout(
        1, model.particle_count, model.particle_count, kind_slots(spring_ends(model)),
        min_valence(ring) if ring else 0, odd=model.substeps % 2 == 1,
        membrane_face=membrane_face_of(model, features, True),
    )  # fmt: skip


LAYOUTS: dict[str, tuple[Callable[[Model, Features], Layout], int]] = {
    "looped": (looped(), 2),
    "looped, in shared memory": (looped("area_vector", "free_velocity"), 2),
    "looped, in another order": (ordered, 2),
    "held": (held, 1),
}
"""and cells of balloons: the one thread keeps all particles, whose source is long"""
