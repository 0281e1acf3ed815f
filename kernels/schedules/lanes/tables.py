"""The model and the working memory of worlds that are simulated eight lanes at a time."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.lanes import Lanes
from balloon_warp.kernels.schedules.lanes.layouts import Layout
from balloon_warp.kernels.tables import Tables


@cache
def part_structs(layout: Layout) -> tuple[Any, Any, Any, Any]:
    """Return the types of the tables of faces, fans, necks and outer forces, with the names of those of one world."""
    Index, Number = layout.reference, layout.number  # noqa: N806 - types

    @wp.struct
    class LaneFaces:
        """Faces, or eight at a time, and the faces around each item."""

        offsets: wp.array[wp.int32]
        """Begin of each face's corners, and the end of the last"""
        particles: wp.array[Index]
        balloon_offsets: wp.array[wp.int32]
        """Begin of each balloon's faces, and the end of the last"""
        particle_offsets: wp.array[wp.int32]
        """Begin of the faces around each item in `around_particles`, and the end of the last"""
        around_particles: wp.array[Index]

    @wp.struct
    class LaneFans:
        """The corners of the faces at each item, each seen from there."""

        offsets: wp.array[wp.int32]
        """Begin of each item's corners in `begins`, and the end of the last"""
        begins: wp.array[wp.int32]
        """Begin of the other particles of each corner, and the end of the last"""
        particles: wp.array[Index]

    @wp.struct
    class LaneNecks:
        """Shares of items in the thrust of an open neck; empty if there is none."""

        weights: wp.array[Number]

    @wp.struct
    class LaneForces:
        """Shares of items in the first of the outer forces on them, 0 if there is none; empty if none acts."""

        slots: wp.array2d[Number]

    return LaneFaces, LaneFans, LaneNecks, LaneForces


@cache
def params_structs(layout: Layout) -> tuple[Any, Any]:
    """Return the types of an item's parameters and indices, and of one particle's."""
    Number = layout.number  # noqa: N806 - a type

    @wp.struct
    class LaneParams:
        """Parameters and indices of an item."""

        group: wp.int32
        number: wp.int32
        balloon: wp.int32
        kind: wp.int32
        share: Number
        mass: Lanes
        n: wp.array[Lanes]

    @wp.struct
    class OneParams:
        """Parameters and indices of one particle."""

        world: wp.int32
        number: wp.int32
        balloon: wp.int32
        kind: wp.int32
        share: float
        mass: float
        n: wp.array[float]

    return LaneParams, OneParams


class LaneStructs(NamedTuple):
    """Types."""

    tables: Any
    params: Any
    """Function that reads the parameters of an item"""
    one: Any
    """Function that reads the parameters of one of its particles"""


@cache
def lane_structs(layout: Layout) -> LaneStructs:
    """Return the types of a layout."""
    Number, Index, Vector, Four = layout.number, layout.reference, layout.vector, layout.four  # noqa: N806 - types
    LaneFaces, LaneFans, LaneNecks, LaneForces = part_structs(layout)  # noqa: N806

    @wp.struct
    class LaneTables:
        """The model item by item. Padding of an octet refers to itself and does nothing."""

        all: Tables
        world_count: wp.int32
        up: wp.vec3
        step_seconds: float
        substeps: wp.int32
        lane_count: wp.int32  # 8, as a number that no loop is unrolled for
        item_offsets: wp.array[wp.int32]
        """Begin of each balloon's items, and the end of the last"""
        shares: wp.array[Number]
        """Share of each item in the balloon's mass"""
        particles: wp.array[wp.int32]
        """Particle at each place of an octet; for eight worlds, of each item"""
        places: wp.array[wp.int32]
        """Place of each particle among the items"""
        present: wp.array[Lanes]
        """1 where an octet has a particle, 0 where it is padded; empty for eight worlds"""
        held: wp.array[wp.int32]
        """Whether a string holds any of an item's particles"""
        spring_offsets: wp.array[wp.int32]
        """Begin of the springs of each item, and the end of the last"""
        spring_kinds: wp.array[wp.int32]
        spring_ends: wp.array[Index]
        spring_scales: wp.array[Number]
        """Spring constants over those of their kinds; empty if all are 1"""
        spring_lengths: wp.array[Number]
        quad_offsets: wp.array[wp.int32]
        """Begin of the quads of each balloon's membrane, or of eights of them, and the end of the last"""
        quads: wp.array[Index]
        """Corners of quads, four each; a triangle has its first again as the third"""
        quad_triangles: wp.array[wp.int32]
        """Number of corners of a quad that have a triangle: all, or the first alone"""
        quad_rests: wp.array[Four]
        """Rest metrics of the triangles at their corners, four each, see `kernels.tables.MembraneTable`"""
        quad_numbers: wp.array[Index]
        """Numbers of the triangles at their corners, four each, below 0 where there is none; empty unless rubber
        wears"""
        fans: LaneFans
        faces: LaneFaces
        necks: LaneNecks
        outer: LaneForces
        numbers: wp.array3d[Lanes]
        """Working memory, a row for each group, as are the next arrays: parameters of balloons and worlds, see
        `laws.columns`"""
        rows: wp.array4d[float]
        """Parameters by group, lane and balloon"""
        forces: wp.array2d[Vector]
        """Forces of hinges and membranes on each particle [N]"""

    return LaneStructs(LaneTables, *params_structs(layout))
