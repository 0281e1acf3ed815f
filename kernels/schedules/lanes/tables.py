"""The model and the working memory of worlds that are simulated eight lanes at a time."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.lanes import Lanes
from balloon_warp.kernels.schedules.lanes.layouts import Layout
from balloon_warp.kernels.tables import Tables


@cache
def part_structs(layout: Layout) -> tuple[Any, Any, Any]:
    """The types of the tables of faces, fans and necks, whose fields are named as those of one world."""
    Index, Number = layout.index, layout.number  # noqa: N806 - types

    @wp.struct
    class LaneFaces:
        """Faces, or eight at a time, and the faces around each item."""

        offsets: wp.array[wp.int32]
        """where the corners of each begin, and after the last, where they end"""
        particles: wp.array[Index]
        balloon_offsets: wp.array[wp.int32]
        """where those of each balloon begin, and after the last, where they end"""
        particle_offsets: wp.array[wp.int32]
        """where the faces around each item begin in `around_particles`, and after the last, where they end"""
        around_particles: wp.array[Index]

    @wp.struct
    class LaneFans:
        """The corners of the faces at each item, each seen from there."""

        offsets: wp.array[wp.int32]
        """where each item's corners begin in `begins`, and after the last, where they end"""
        begins: wp.array[wp.int32]
        """where the others of each corner begin, and after the last, where they end"""
        particles: wp.array[Index]

    @wp.struct
    class LaneNecks:
        """Each item's part of the thrust of an open neck; empty if there is none."""

        weights: wp.array[Number]

    return LaneFaces, LaneFans, LaneNecks


@cache
def own_structs(layout: Layout) -> tuple[Any, Any]:
    """The types of what an item knows of itself, and of what one particle of it does."""
    Number = layout.number  # noqa: N806 - a type

    @wp.struct
    class LaneOwn:
        """What an item knows of itself."""

        group: wp.int32
        number: wp.int32
        balloon: wp.int32
        kind: wp.int32
        share: Number
        mass: Lanes
        n: wp.array[Lanes]

    @wp.struct
    class OneOwn:
        """What one particle knows of itself."""

        world: wp.int32
        number: wp.int32
        balloon: wp.int32
        kind: wp.int32
        share: float
        mass: float
        n: wp.array[float]

    return LaneOwn, OneOwn


class LaneStructs(NamedTuple):
    """Types."""

    tables: Any
    own: Any
    """what an item knows of itself"""
    one: Any
    """what one particle of it does"""


@cache
def lane_structs(layout: Layout) -> LaneStructs:
    """The types of a layout."""
    Number, Index, Vector, Four = layout.number, layout.index, layout.vector, layout.four  # noqa: N806 - types
    LaneFaces, LaneFans, LaneNecks = part_structs(layout)  # noqa: N806

    @wp.struct
    class LaneTables:
        """The model item by item. What is filled up in an octet refers to itself and does nothing."""

        all: Tables
        world_count: wp.int32
        up: wp.vec3
        step_seconds: float
        substeps: wp.int32
        lane_count: wp.int32  # 8, as a number that no loop is unrolled for
        item_offsets: wp.array[wp.int32]
        """where each balloon's items begin, and after the last, where they end"""
        shares: wp.array[Number]
        """of the balloon's mass"""
        particles: wp.array[wp.int32]
        """the particle of each place of an octet; of eight worlds, of each item"""
        places: wp.array[wp.int32]
        """where each particle stands among them"""
        present: wp.array[Lanes]
        """of each octet, 1 where a particle is, 0 where it is filled up; of eight worlds nothing"""
        held: wp.array[wp.int32]
        """of each item, whether a string holds any of its particles"""
        spring_offsets: wp.array[wp.int32]
        """where the springs of each item begin, and after the last, where they end"""
        spring_kinds: wp.array[wp.int32]
        spring_ends: wp.array[Index]
        spring_scales: wp.array[Number]
        """a spring's constant over that of its kind; empty if all are 1"""
        spring_lengths: wp.array[Number]
        quad_offsets: wp.array[wp.int32]
        """where those of each balloon's membrane begin, or eight at a time, and after the last, where they end"""
        quads: wp.array[Index]
        """their corners, four each; a triangle has its first again as the third"""
        quad_triangles: wp.array[wp.int32]
        """at how many of their corners they have a triangle: all, or the first alone"""
        quad_rests: wp.array[Four]
        """what the triangles at their corners are at rest, four each, see `kernels.tables.MembraneTable`"""
        quad_numbers: wp.array[Index]
        """of the triangles at their corners, four each, below 0 where there is none; empty unless rubber wears"""
        fans: LaneFans
        faces: LaneFaces
        necks: LaneNecks
        numbers: wp.array3d[Lanes]
        """working memory, a row for each group, as what follows: the parameters of balloons and worlds, see
        `laws.columns`"""
        rows: wp.array4d[float]
        """the same, by group, lane and balloon"""
        peaks: wp.array2d[Lanes]
        """of the triangles at the corners of quads, see `State`, four each; empty unless rubber softens"""
        forces: wp.array2d[Vector]
        """what hinges and membranes have added up, on each particle [N]"""

    return LaneStructs(LaneTables, *own_structs(layout))
