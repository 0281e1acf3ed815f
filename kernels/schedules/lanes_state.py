"""Tables of eight lanes, and transfer of the state into them and back."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.algebra import times
from balloon_warp.kernels.compose import ramp_at
from balloon_warp.kernels.contact.free_frames import FREE
from balloon_warp.kernels.features import Features, Kept
from balloon_warp.kernels.lanes import IN_LANES, LANE_COUNT, Lanes, Lanes2, Lanes3, of_lane, set_lane
from balloon_warp.kernels.loops.contact import Solids, solid_function
from balloon_warp.kernels.memory import put_vector_in, two_in, vector_in
from balloon_warp.kernels.schedules.lanes_layouts import Layout, column_at, of_item, places_of
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world
from balloon_warp.kernels.warps import set_quanta, total_newtons
from balloon_warp.kernels.working import Working


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
        `kernels.laws.Columns`"""
        rows: wp.array4d[float]
        """Parameters by group, lane and balloon"""
        forces: wp.array2d[Vector]
        """Forces of hinges and membranes on each particle [N]"""

    return LaneStructs(LaneTables, *params_structs(layout))


@wp.func_native(
    """
    auto& item = vectors.data[(unsigned int)index].data;
    for (int axis = 0; axis < 3; ++axis)
        item[axis][lane] = vector[axis];
    """
)
def put_in_lane(vectors: wp.array[Lanes3], index: wp.int32, lane: wp.int32, vector: wp.vec3):
    """Store the vector of one lane of an item, without the others' going through registers."""
    ...


@wp.func
def put_in_lane(vectors: wp.array[wp.vec4], index: wp.int32, lane: wp.int32, vector: wp.vec3):  # noqa: F811 - an overload
    """Store the vector of one particle of an octet."""
    vectors[LANE_COUNT * index + lane] = wp.vec4(vector[0], vector[1], vector[2], 0.0)


@cache
def kept_functions(kept: Kept, layout: Layout) -> dict[str, Any]:
    """Return the functions that read kept values from the state, and that write those of particles, by their names."""
    LaneTables, places = lane_structs(layout).tables, places_of(layout)  # noqa: N806 - a type
    InLanes, number_type = IN_LANES[kept.type], wp.array2d(dtype=kept.type)  # noqa: N806 - a type

    @wp.func
    def take_kept(t: LaneTables, kept: number_type, group: wp.int32, item: wp.int32):
        lanes = InLanes()
        for lane in range(t.lane_count):
            world = places.world(group, lane, t.world_count)
            lanes = set_lane(lanes, lane, kept[world, places.particle(t, item, lane)])
        return lanes

    @wp.func
    def take_kept_of_other(t: LaneTables, kept: number_type, group: wp.int32, item: wp.int32):
        lanes = InLanes()
        for lane in range(t.lane_count):
            lanes = set_lane(lanes, lane, kept[places.world(group, lane, t.world_count), item])
        return lanes

    if kept.item != "particle":
        return {f"{kept.name}_of": take_kept_of_other}

    @wp.func
    def put_kept(t: LaneTables, kept: number_type, group: wp.int32, item: wp.int32, lanes: InLanes):
        for lane in range(t.lane_count):
            if places.is_there(t, group, item, lane):
                world = places.world(group, lane, t.world_count)
                kept[world, places.particle(t, item, lane)] = of_lane(lanes, lane)

    return {f"{kept.name}_of": take_kept, f"put_{kept.name}": put_kept}


@cache
def reading_functions(features: Features, layout: Layout) -> tuple[Any, Any]:
    """Return the functions that read numbers, and where particles are and how fast."""
    LaneTables, places = lane_structs(layout).tables, places_of(layout)  # noqa: N806 - a type
    split = features.columns.balloon_width

    @wp.func
    def read_numbers(t: LaneTables, group: wp.int32):
        """Read the parameters of balloons and worlds."""
        for lane in range(t.lane_count):
            world = places.world(group, lane, t.world_count)
            of_balloons = row_of_world(world, t.all.balloon_numbers.shape[0])
            of_world = row_of_world(world, t.all.world_numbers.shape[0])
            for balloon in range(t.all.inflation_kind.shape[0]):
                for column in range(t.all.balloon_numbers.shape[2]):
                    t.numbers[group, balloon, column][lane] = t.all.balloon_numbers[of_balloons, balloon, column]
                for column in range(t.all.world_numbers.shape[1]):
                    t.numbers[group, balloon, split + column][lane] = t.all.world_numbers[of_world, column]

    @wp.func
    def read_particles(
        t: LaneTables, group: wp.int32, from_points: wp.array2d[wp.vec3], from_velocities: wp.array2d[wp.vec3],
        points: Any, velocities: Any,
    ):  # fmt: skip
        """Read points and velocities."""
        for item in range(t.item_offsets[t.all.inflation_kind.shape[0]]):
            for lane in range(t.lane_count):
                world = places.world(group, lane, t.world_count)
                particle = places.particle(t, item, lane)
                put_in_lane(points, item, lane, vector_in(from_points, world, particle))
                put_in_lane(velocities, item, lane, vector_in(from_velocities, world, particle))

    return read_numbers, read_particles


@cache
def writing_function(layout: Layout) -> Any:
    """Return the function that writes vectors of particles to where each world has them."""
    LaneTables, places = lane_structs(layout).tables, places_of(layout)  # noqa: N806 - a type

    @wp.func
    def write_vectors(t: LaneTables, group: wp.int32, vectors: wp.array[Lanes3], to: wp.array2d[wp.vec3]):
        for item in range(t.item_offsets[t.all.inflation_kind.shape[0]]):
            for lane in range(t.lane_count):
                if places.is_there(t, group, item, lane):
                    world = places.world(group, lane, t.world_count)
                    put_vector_in(to, world, places.particle(t, item, lane), column_at(vectors, item, lane))

    return write_vectors


@cache
def frame_functions(features: Features, layout: Layout) -> tuple[Any, Any]:
    """Return the functions that read the state as a frame begins, and that write it as it ends."""
    LaneTables, places = lane_structs(layout).tables, places_of(layout)  # noqa: N806 - a type
    read_numbers, read_particles = reading_functions(features, layout)

    @wp.func
    def counts(working: Working, world: wp.int32):
        """Return whether the results of a world count: not if its frame was not free, where only free frames count."""
        if wp.static(features.watched):
            return working.verdicts[world] == FREE
        else:
            return True

    @wp.func
    def end_of(t: LaneTables, group: wp.int32):
        """Return the end of a group's worlds."""
        return places.first_world(group) + places.worlds(group, t.world_count)

    @wp.func
    def read_frame(t: LaneTables, state: WorldState, working: Working, group: wp.int32, points: Any, velocities: Any):
        """Read numbers, points and velocities, and the forces that the last frame left on spheres."""
        read_numbers(t, group)
        if wp.static(features.penalties):
            for world in range(places.first_world(group), end_of(t, group)):
                for sphere in range(state.sphere_forces.shape[1]):
                    set_quanta(working.sphere_quanta, world, sphere, state.sphere_forces[world, sphere])
        read_particles(t, group, state.points, state.velocities, points, velocities)

    @wp.func
    def write_frame(
        t: LaneTables,
        state: WorldState,
        working: Working,
        group: wp.int32,
        points: Any,
        velocities: Any,
    ):
        """Write forces on spheres, points and velocities.

        If only free frames count, of worlds with a free frame.
        """
        if wp.static(features.penalties):
            for world in range(places.first_world(group), end_of(t, group)):
                for sphere in range(state.sphere_forces.shape[1]):
                    state.sphere_forces[world, sphere] = total_newtons(working.sphere_quanta, world, sphere)
        for item in range(t.item_offsets[t.all.inflation_kind.shape[0]]):
            point = of_item(points, item)
            velocity = of_item(velocities, item)
            for lane in range(t.lane_count):
                world = places.world(group, lane, t.world_count)
                if places.is_there(t, group, item, lane) and counts(working, world):
                    particle = places.particle(t, item, lane)
                    state.points[world, particle] = of_lane(point, lane)
                    state.velocities[world, particle] = of_lane(velocity, lane)

    return read_frame, write_frame


@cache
def balloon_functions(layout: Layout) -> dict[str, Any]:
    """Return the functions that read a balloon's values in all lanes, by their names."""
    LaneTables, places = lane_structs(layout).tables, places_of(layout)  # noqa: N806 - a type

    @wp.func
    def ramps_of(t: LaneTables, state: WorldState, group: wp.int32, balloon: wp.int32, time_in_frame: float):
        """Return the keyframed values of a balloon."""
        ramps = Lanes()
        for lane in range(t.lane_count):
            ramps[lane] = ramp_at(state, places.world(group, lane, t.world_count), balloon, time_in_frame)
        return ramps

    @wp.func
    def loads_of(t: LaneTables, state: WorldState, group: wp.int32, balloon: wp.int32):
        """Return the pressures at height 0 [Pa], and their rises with height [Pa/m]."""
        loads = Lanes2()
        for lane in range(t.lane_count):
            world = places.world(group, lane, t.world_count)
            loads = set_lane(loads, lane, two_in(state.inflation_loads, world, balloon))
        return loads

    @wp.func
    def gas_masses_of(t: LaneTables, working: Working, group: wp.int32, balloon: wp.int32):
        """Return the mass of the gas [kg]."""
        masses = Lanes()
        for lane in range(t.lane_count):
            masses[lane] = working.gas_masses[places.world(group, lane, t.world_count), balloon]
        return masses

    @wp.func
    def travel_limits_of(t: LaneTables, working: Working, group: wp.int32):
        """Return the distance that particles may travel in a free frame [m]."""
        travel_limits = Lanes()
        for lane in range(t.lane_count):
            travel_limits[lane] = working.travel_limits[places.world(group, lane, t.world_count)]
        return travel_limits

    @wp.func
    def any_free(t: LaneTables, working: Working, group: wp.int32):
        """Return whether any world of a group has a free frame."""
        found = bool(False)
        for lane in range(t.lane_count):
            found = found or working.verdicts[places.world(group, lane, t.world_count)] == FREE
        return found

    return {
        "travel_limits_of": travel_limits_of,
        "any_free": any_free,
        "ramps_of": ramps_of,
        "loads_of": loads_of,
        "gas_masses_of": gas_masses_of,
    }


@cache
def params_functions_of(mass: int, layout: Layout) -> tuple[Any, Any, Any]:
    """Return the functions that read the parameters of an item, of a quad, and of one particle.

    Args:
        mass: its column.
    """
    LaneTables, LaneParams, OneParams = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)

    @wp.func
    def params_of_quad(t: LaneTables, group: wp.int32, balloon: wp.int32, number: wp.int32):
        params = LaneParams()
        params.group = group
        params.number = number
        params.balloon = balloon
        params.kind = t.all.inflation_kind[balloon]
        params.n = t.numbers[group, balloon]
        return params

    @wp.func
    def params_of(t: LaneTables, group: wp.int32, balloon: wp.int32, item: wp.int32):
        params = params_of_quad(t, group, balloon, item)
        params.share = t.shares[item]
        params.mass = times(params.share, params.n[mass])
        return params

    @wp.func
    def params_of_one(t: LaneTables, params: LaneParams, lane: wp.int32):
        one = OneParams()
        one.world = places.world(params.group, lane, t.world_count)
        one.number = places.particle(t, params.number, lane)
        one.balloon = params.balloon
        one.kind = params.kind
        one.share = of_lane(params.share, lane)
        one.mass = params.mass[lane]
        one.n = t.rows[params.group, lane, params.balloon]
        return one

    return params_of, params_of_quad, params_of_one


@cache
def showing_function(features: Features, layout: Layout) -> Any:
    """Return the function that loads spheres and obstacles into the lanes."""
    LaneTables, places = lane_structs(layout).tables, places_of(layout)  # noqa: N806 - a type
    solid_at = solid_function(features)

    @wp.func
    def show_solids(t: LaneTables, tables: Tables, state: WorldState, solids: Solids, group: wp.int32, end: float):
        """Store the solids in the lanes as they are at the end of a substep."""
        for solid in range(solids.centers.shape[1]):
            centers, motions, reaches = Lanes3(), Lanes3(), Lanes()
            for lane in range(t.lane_count):
                world = places.world(group, lane, t.world_count)
                center, motion, reach = solid_at(tables, state, world, solid, end)
                centers = set_lane(centers, lane, center)
                motions = set_lane(motions, lane, motion)
                reaches[lane] = reach
            solids.centers[group, solid] = centers
            solids.motions[group, solid] = motions
            solids.reaches[group, solid] = reaches

    return show_solids
