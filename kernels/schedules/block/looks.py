"""Access of items to each other where points are in a block's shared memory."""

from collections.abc import Callable
from functools import cache
from typing import Any

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.membrane_face_looks import kept_springs, membrane_face_functions
from balloon_warp.kernels.loops.net_force import Loops, scalar_loops
from balloon_warp.kernels.loops.slots import ring_area, ring_normal, slot_loop, springs_reader
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.phase import Look
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.spheres import shared_spheres


@cache
def looping_loops(features: Features) -> Loops:
    """Return loops over the entries of tables."""
    return scalar_loops(features, in_tile, inflation_directions=features.directions_on_the_way)


@cache
def held_loops(slots: tuple[int, int, int], rings: int) -> Callable[[Features], Loops]:
    """Return loops over springs that are held in registers."""

    @cache
    def loops_of(features: Features) -> Loops:
        area_vector = ring_area(slots[0], rings) if rings else None
        vertex_normal = ring_normal(slots[0]) if features.directions_on_the_way else None
        return scalar_loops(features, in_tile, slot_loop(features, slots), area_vector, vertex_normal)

    return loops_of


@cache
def look_of(layout: Layout, spheres: int) -> Look:
    """Return how items see each other on a layout, with so many spheres."""
    look = Look(in_tile, shared_spheres(spheres)[2] if spheres else None, looping_loops, put=put_in_tile)
    if layout.membrane_face:
        membrane_face, slots = layout.membrane_face, layout.slots if layout.held else None
        look = look._replace(
            loops=lambda features: membrane_face_functions(features, membrane_face, slots).loops,
            membrane_faces=lambda features: membrane_face_functions(features, membrane_face, slots),
        )
    elif layout.held or any(layout.slots):
        look = look._replace(loops=held_loops(layout.slots, layout.rings), slots=layout.slots, ring=layout.rings)
    return look._replace(velocity_at=in_tile, put_velocity=put_in_tile) if "velocity" in layout.tiles else look


def reader_of_springs(features: Features, layout: Layout, derived: bool = False) -> Any:
    """Return the function that reads a particle's kept springs, and places of its faces.

    Args:
        derived: whether it is read for derivatives, too.
    """
    if layout.membrane_face:
        return kept_springs(features, layout.membrane_face, layout.slots)[1]
    return springs_reader(features, layout.slots, derived)[1]
