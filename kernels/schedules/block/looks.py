"""Access of items to each other where points are in a block's shared memory."""

from collections.abc import Callable
from functools import cache
from typing import Any

from balloon_warp.kernels.loops.film_looks import film_functions, kept_springs
from balloon_warp.kernels.loops.net_force import Loops, scalar_loops
from balloon_warp.kernels.loops.slots import ring_area, ring_facing, slot_loop, springs_reader
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.phase import Look
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.spheres import shared_spheres
from balloon_warp.kernels.traits import Traits


@cache
def looping_loops(traits: Traits) -> Loops:
    """Return loops over the entries of tables."""
    return scalar_loops(traits, in_tile, aims=traits.aims_on_the_way)


@cache
def held_loops(slots: tuple[int, int, int], rings: int) -> Callable[[Traits], Loops]:
    """Return loops over springs that are held in registers."""

    @cache
    def loops_of(traits: Traits) -> Loops:
        area_vector = ring_area(slots[0], rings) if rings else None
        facing = ring_facing(slots[0]) if traits.aims_on_the_way else None
        return scalar_loops(traits, in_tile, slot_loop(traits, slots), area_vector, facing)

    return loops_of


@cache
def look_of(layout: Layout, spheres: int) -> Look:
    """Return how items see each other on a layout, with so many spheres."""
    look = Look(in_tile, shared_spheres(spheres)[2] if spheres else None, looping_loops, put=put_in_tile)
    if layout.film:
        film, slots = layout.film, layout.slots if layout.held else None
        look = look._replace(
            loops=lambda traits: film_functions(traits, film, slots).loops,
            films=lambda traits: film_functions(traits, film, slots),
        )
    elif layout.held:
        look = look._replace(loops=held_loops(layout.slots, layout.rings))
    return look._replace(velocity_at=in_tile, put_velocity=put_in_tile) if "velocity" in layout.tiles else look


def reader_of_springs(traits: Traits, layout: Layout) -> Any:
    """Return the function that reads what a particle keeps of its springs, and of its faces."""
    if layout.film:
        return kept_springs(traits, layout.film, layout.slots)[1]
    return springs_reader(traits, layout.slots)[1]
