"""Layouts that only a GPU chooses by itself, for a CPU, where a block is one thread."""

from collections.abc import Callable

from balloon_warp.kernels.loops.film_places import FilmLayout
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model
from balloon_warp.schedules.films import film_entries, film_layout
from balloon_warp.schedules.rings import least_valence, quad_rings
from balloon_warp.schedules.slots import kind_slots
from balloon_warp.schedules.spring_ends import spring_ends


def film_of(model: Model, traits: Traits, held: bool) -> FilmLayout | None:
    film = film_layout(model, traits)
    if film is None or not held:
        return film._replace(areas=False) if film else None
    film = film._replace(capacity=model.particle_count)
    return film._replace(tile=film_entries(model, film))


def looped(*tiles: str) -> Callable[[Model, Traits], Layout]:
    def layout(model: Model, traits: Traits) -> Layout:
        kept = () if traits.looks_at_velocities or traits.impulses else ("velocity",)
        odd, film = model.substeps % 2 == 1, film_of(model, traits, False)
        return Layout(1, model.particle_count, tiles=(*kept, *tiles) if tiles else (), odd=odd, film=film)

    return layout


def ordered(model: Model, traits: Traits) -> Layout:
    layout = looped("area_vector", "free_velocity")(model, traits)
    return layout._replace(ordered="velocity" in layout.tiles and not (traits.membranes or traits.keeps))


def held(model: Model, traits: Traits) -> Layout:
    ring = quad_rings(model) if traits.measures_areas or traits.aims_on_the_way else None
    return Layout(
        1, model.particle_count, model.particle_count, kind_slots(spring_ends(model)),
        least_valence(ring) if ring else 0, odd=model.substeps % 2 == 1, film=film_of(model, traits, True),
    )  # fmt: skip


LAYOUTS: dict[str, tuple[Callable[[Model, Traits], Layout], int]] = {
    "looped": (looped(), 2),
    "looped, in shared memory": (looped("area_vector", "free_velocity"), 2),
    "looped, in another order": (ordered, 2),
    "held": (held, 1),
}
"""and cells of balloons: the one thread keeps all particles, whose source is long"""
