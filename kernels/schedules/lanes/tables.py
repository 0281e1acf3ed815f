"""The model and the working memory of worlds that are simulated eight lanes at a time."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import Lanes, Lanes3
from balloon_warp.kernels.contact.free_frames import FreeFrames
from balloon_warp.kernels.schedules.lanes.layouts import Layout
from balloon_warp.kernels.tables import Tables


@cache
def face_structs(layout: Layout) -> tuple[Any, Any]:
    """The types of the tables of faces and of their fans, whose fields are named as those of one world."""
    Index = layout.index  # noqa: N806 - a type

    @wp.struct
    class LaneFaces:
        """Faces, or eight at a time, and the faces around each item."""

        offsets: wp.array[wp.int32]
        """where the corners of each begin, and after the last, where they end"""
        particles: wp.array[Index]
        balloon: wp.array[wp.int32]
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

    return LaneFaces, LaneFans


@cache
def lane_structs(layout: Layout) -> tuple[Any, Any, Any]:
    """The types of the tables, of the working memory, and of what an item knows of itself."""
    Number, Index, Vector, Four = layout.number, layout.index, layout.vector, layout.four  # noqa: N806 - types
    LaneFaces, LaneFans = face_structs(layout)  # noqa: N806

    @wp.struct
    class LaneTables:
        """The model item by item. What is filled up in an octet refers to itself and does nothing."""

        all: Tables
        seen: Tables
        """the same with faces and hinges by places, as the lanes of an octet are numbered"""
        world_count: wp.int32
        up: wp.vec3
        step_seconds: float
        lane_count: wp.int32  # 8, as a number that no loop is unrolled for
        item_offsets: wp.array[wp.int32]
        """where each balloon's items begin, and after the last, where they end"""
        shares: wp.array[Number]
        """of the balloon's mass"""
        neck_weights: wp.array[Number]
        """of the thrust of its neck; empty unless one is open"""
        particles: wp.array[wp.int32]
        """the particle of each place of an octet; of eight worlds, of each item"""
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
        """of the triangles at their corners, four each, below 0 where there is none; empty unless rubber softens"""
        fans: LaneFans
        faces: LaneFaces
        hinge_forces: wp.array2d[Vector]
        """working memory, which the loops over particles read: of each hinge's four roles [N], a row for each group"""
        membrane_forces: wp.array2d[Vector]
        """the same of membranes on each particle [N]"""

    @wp.struct
    class LaneState:
        """Working memory, a row for each group of eight worlds, or for each world."""

        points: wp.array2d[Vector]
        other_points: wp.array2d[Vector]
        velocities: wp.array2d[Lanes3]
        free_velocities: wp.array2d[Lanes3]
        """without the inflation; empty where there is no gas"""
        shown_velocities: wp.array2d[Vector]
        """before the substep; empty unless neighbors look at them"""
        aims: wp.array2d[Lanes3]
        area_vectors: wp.array2d[Lanes3]
        inflations: wp.array2d[Lanes3]
        """empty unless corrections come between them and spheres"""
        face_centers: wp.array2d[Vector]
        face_area_vectors: wp.array2d[Vector]
        balloon_areas: wp.array2d[Lanes]
        numbers: wp.array3d[Lanes]
        """the parameters of balloons and worlds, see `laws.columns`"""
        peaks: wp.array2d[Lanes]
        """of the triangles at the corners of quads, see `State`, four each; empty unless rubber softens"""
        ramp_begins: wp.array2d[Lanes]
        ramp_slopes: wp.array2d[Lanes]
        loads: wp.array2d[Lanes]
        rises: wp.array2d[Lanes]
        masses: wp.array2d[Lanes]
        """of balloons with their gas [kg]"""
        sphere_centers: wp.array2d[Lanes3]
        sphere_motions: wp.array2d[Lanes3]
        sphere_starts: wp.array2d[wp.vec3]
        """of each world; empty unless spheres may meet"""
        """their velocities; empty unless they exchange momentum with particles, as is what follows"""
        near_items: wp.array2d[wp.int32]
        """the items that may touch a sphere"""
        sphere_squared_radii: wp.array2d[Lanes]
        free: FreeFrames
        """which worlds have a free frame; empty unless balloons touch"""
        fastest: wp.array[Lanes]
        """square of the highest speed so far in each lane, in a free frame [m^2/s^2]"""

    @wp.struct
    class LaneOwn:
        """What an item knows of itself."""

        group: wp.int32
        item: wp.int32
        balloon: wp.int32
        kind: wp.int32
        share: Number
        mass: Lanes
        n: wp.array[Lanes]

    return LaneTables, LaneState, LaneOwn
