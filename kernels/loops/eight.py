"""Loops over the forces on eight particles side by side.

Springs, area vectors and laws on particles are vector instructions throughout. Strings, water and laws on faces are
rarer: for them each lane is looked at by itself, by the loops for one particle. Hinges and membranes have been added up
before, see `phases.stretch`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import dot_product, plus_scaled, scaled, squared_length
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3, Lanes4, entry_at, of_lane, set_lane
from balloon_warp.kernels.loops.areas import CROSSES, area_loop, cross_at_quad_corner
from balloon_warp.kernels.loops.net_force import Loops, one_after_the_other, string_loop
from balloon_warp.kernels.loops.wetness import ring_wetness_loop, wetness_loop
from balloon_warp.kernels.memory import int_at


@wp.func
def is_self(end: wp.int32, own: wp.int32, lane: wp.int32):
    """Return whether a spring leads from a particle to itself."""
    return end == own


@wp.func
def is_self(end: Any, own: wp.int32, lane: wp.int32):  # noqa: F811 - an overload
    """Return whether a spring leads from a particle of an octet to itself."""
    return end[lane] == LANE_COUNT * own + lane


@cache
def spring_loop_of_eight(features: Features, at: Any) -> Any:
    """Return the function that sums the springs of eight particles."""
    coefficient_in_lane = features.laws_in_lane_on("spring")
    moving = features.needs("spring", "opening")

    @wp.func
    def pull_of_springs(
        t: Any, points: Any, velocities: Any, params: Any, springs: Any, point: Lanes3, velocity: Lanes3, time: float
    ):
        """Return the net force of the springs [N]."""
        force = Lanes3()
        for entry in range(t.spring_offsets[params.number], t.spring_offsets[params.number + 1]):
            end = entry_at(t.spring_ends, entry)
            length = entry_at(t.spring_lengths, entry)
            constants = entry_at(params.n, entry_at(t.spring_kinds, entry))
            d = at(points, end) - point
            squared = squared_length(d)
            opening = Lanes()
            if wp.static(moving):
                opening = dot_product(at(velocities, end) - velocity, d)
            coefficients = Lanes()
            for lane in range(LANE_COUNT):
                stiffness = constants[lane]
                if wp.static(features.springs_vary):
                    stiffness *= of_lane(t.spring_scales[entry], lane)
                coefficients[lane] = coefficient_in_lane(
                    squared[lane], opening[lane], of_lane(length, lane), stiffness,
                    stiffness * of_lane(length, lane), t.step_seconds, time, params.n, lane,
                )  # fmt: skip
                if wp.static(features.guarded):
                    coefficients[lane] = wp.where(is_self(end, params.number, lane), 0.0, coefficients[lane])
            force = plus_scaled(force, d, coefficients)
        return force

    return pull_of_springs


@cache
def area_loop_of_eight(features: Features, at: Any) -> Any:
    """Return the function that sums the area vectors of eight particles."""
    area_vector_in_faces = area_loop(False, at)

    @wp.func
    def area_vector(t: Any, points: Any, params: Any, springs: Any, point: Lanes3):
        """Return the area vectors of eight particles [m^2]."""
        if wp.static(not features.quads):
            return area_vector_in_faces(t.fans, points, params.number, point)
        else:
            total = Lanes3()
            for entry in range(t.fans.offsets[params.number], t.fans.offsets[params.number + 1]):
                begin = int_at(t.fans.begins, entry)
                total += cross_at_quad_corner(
                    at(points, entry_at(t.fans.particles, begin + 2)) - point,
                    at(points, entry_at(t.fans.particles, begin + 1)) - point,
                    at(points, entry_at(t.fans.particles, begin)) - point,
                )
            return scaled(total, CROSSES)

    return area_vector


@cache
def laws_of_eight(features: Features) -> Any:
    """Return the function that adds the laws on particles."""
    laws_in_lane = features.laws_in_lane_on("particle")

    @wp.func
    def particle_laws(
        so_far: Lanes3,
        position: Lanes3,
        velocity: Lanes3,
        mass: Lanes,
        mass_share: Any,
        area_vector: Lanes3,
        water_load: Any,
        up: wp.vec3,
        step_seconds: float,
        time: float,
        n: wp.array[Lanes],
    ):
        """Return the force with that of the laws on particles [N]."""
        force = Lanes3()
        for lane in range(LANE_COUNT):
            of_one = laws_in_lane(
                position, velocity, mass, mass_share, area_vector, water_load, up, step_seconds, time, n, lane
            )
            force[0, lane] = of_one[0]
            force[1, lane] = of_one[1]
            force[2, lane] = of_one[2]
        return so_far + force

    return particle_laws


@cache
def loops_of_eight(features: Features, at: Any, take: Any, view_of: Any, params_of_one: Any) -> Loops:
    """Return the loops for eight particles at a time.

    Args:
        at: the function that reads eight points, or of a view of one world one.
        take: the one that takes the sums of hinges and membranes.
        view_of: the one that gives a lane's view of the points.
        params_of_one: the one that gives the parameters of the particle in a lane.
    """
    sum_strings = string_loop(features) if features.has("string") else None
    load_of_particle = ring_wetness_loop(at) if features.rings else wetness_loop(at)
    level = features.columns.places.get("water_level", 0)

    @wp.func
    def pulls_on_one(t: Any, points: Any, velocities: Any, one: Any, point: wp.vec3, velocity: wp.vec3, time: float):
        """Return the forces of strings on one of eight particles [N]."""
        return sum_strings(t.all.strings, one.world, one.number, point, velocity, one.n, t.step_seconds, time)

    @wp.func
    def pulls_one_by_one(
        t: Any, points: Any, velocities: Any, params: Any, point: Lanes3, velocity: Lanes3, time: float
    ):
        """Return the forces of strings on eight particles, one by one [N]."""
        pulls = Lanes3()
        for lane in range(t.lane_count):
            pull = pulls_on_one(
                t, view_of(points, lane, t.places), view_of(velocities, lane, t.places), params_of_one(t, params, lane),
                of_lane(point, lane), of_lane(velocity, lane), time,
            )  # fmt: skip
            pulls = set_lane(pulls, lane, pull)
        return pulls

    @wp.func
    def other_pulls(t: Any, points: Any, velocities: Any, params: Any, point: Lanes3, velocity: Lanes3, time: float):
        """Take the net force of strings, and the sums of hinges, faces and membranes [N], which are cleared."""
        force = Lanes3()
        if wp.static(bool(features.membranes) or features.has("hinge") or features.has("face")):
            force += take(t, params)
        if wp.static(sum_strings is not None):
            if t.held[params.number] > 0:
                force += pulls_one_by_one(t, points, velocities, params, point, velocity, time)
        return force

    @wp.func
    def water_load(t: Any, points: Any, params: Any):
        """Return depth times area vector [m^3], and wetted area [m^2]."""
        loads = Lanes4()
        levels = params.n[level]
        for lane in range(t.lane_count):
            one = params_of_one(t, params, lane)
            view = view_of(points, lane, t.places)
            load = wp.vec4()
            if wp.static(features.rings):
                load = load_of_particle(t.all.rings, view, one.number, levels[lane], t.up)
            else:
                load = load_of_particle(t.all.faces, view, one.number, levels[lane], t.up)
            loads = set_lane(loads, lane, load)
        return loads

    around = one_after_the_other(features, spring_loop_of_eight(features, at), area_loop_of_eight(features, at))
    return Loops(around, other_pulls, water_load, laws_of_eight(features))
