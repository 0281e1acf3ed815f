"""How items see each other where their points stand in the shared memory of a block."""

from functools import cache
from typing import Any

from balloon_warp.kernels.loops.net_force import Loops, scalar_loops
from balloon_warp.kernels.loops.obstacles import sphere_in_state
from balloon_warp.kernels.loops.slots import slot_functions
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.phase import Look
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.traits import Traits


@cache
def looping_loops(traits: Traits) -> Loops:
    """Over what stands in tables."""
    return scalar_loops(traits, in_tile, aims=traits.aims_on_the_way)


@cache
def held_loops(slots: tuple[int, int, int], rings: int) -> Any:
    """Return the loops over what stays in registers, of what a scene has."""

    @cache
    def loops_of(traits: Traits) -> Loops:
        _, _, pull, area_vector, facing = slot_functions(traits, slots, rings, by_place=True)
        finds_aims = traits.aims_on_the_way
        return scalar_loops(traits, in_tile, pull, area_vector if rings else None, facing if finds_aims else None)

    return loops_of


@cache
def look_of(layout: Layout) -> Look:
    """Return how items see each other on a layout."""
    loops = held_loops(layout.slots, layout.rings) if layout.held else looping_loops
    look = Look(in_tile, sphere_in_state, loops, put=put_in_tile)
    return look._replace(velocity_at=in_tile, put_velocity=put_in_tile) if "velocity" in layout.tiles else look


def reader_of_springs(traits: Traits, layout: Layout) -> Any:
    """Return the function that reads what a particle keeps of its springs."""
    return slot_functions(traits, layout.slots, layout.rings, by_place=True)[1]
