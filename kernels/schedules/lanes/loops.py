"""The loops over what acts on the particles of an item, eight lanes at a time.

Springs, area vectors and laws on particles are vector instructions throughout. Strings, hinges, water and laws on faces
are rarer: for them each lane is looked at by itself, by the loops that other schedules have.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import (
    LANE_COUNT,
    Lanes,
    Lanes3,
    Lanes4,
    dot_product,
    of_lane,
    plus_scaled,
    scaled,
    set_lane,
    squared_length,
)
from balloon_warp.kernels.loops.areas import CROSSES, area_loop, cross_at_quad_corner
from balloon_warp.kernels.loops.faces import face_loop
from balloon_warp.kernels.loops.net_force import Loops, one_after_the_other
from balloon_warp.kernels.loops.strings import is_held, string_loop
from balloon_warp.kernels.loops.wetness import ring_wetness_loop, wetness_loop
from balloon_warp.kernels.memory import int_at
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.schedules.lanes.layouts import Layout, entry_at, near, of_item, places_of, view_of
from balloon_warp.kernels.traits import Traits


@wp.func
def is_self(end: wp.int32, own: wp.int32, lane: wp.int32):
    """Whether a spring leads from a particle to itself."""
    return end == own


@wp.func
def is_self(end: Any, own: wp.int32, lane: wp.int32):  # noqa: F811 - an overload
    """Whether a spring leads from a particle of an octet to itself."""
    return end[lane] == LANE_COUNT * own + lane


@cache
def lane_spring_loop(traits: Traits) -> Any:
    """The function that sums the springs of an item."""
    coefficient_in_lane = traits.laws_in_lane_on("spring")
    moving = traits.needs("spring", "opening")

    @wp.func
    def pull_of_springs(
        t: Any, points: Any, velocities: Any, own: Any, springs: Any, point: Lanes3, velocity: Lanes3, time: float
    ):
        """Net force of the springs [N]."""
        force = Lanes3()
        for entry in range(t.spring_offsets[own.item], t.spring_offsets[own.item + 1]):
            end = entry_at(t.spring_ends, entry)
            length = entry_at(t.spring_lengths, entry)
            constants = entry_at(own.n, entry_at(t.spring_kinds, entry))
            d = near(points, end) - point
            squared = squared_length(d)
            opening = Lanes()
            if wp.static(moving):
                opening = dot_product(near(velocities, end) - velocity, d)
            coefficients = Lanes()
            for lane in range(LANE_COUNT):
                stiffness = constants[lane]
                if wp.static(traits.springs_vary):
                    stiffness *= of_lane(t.spring_scales[entry], lane)
                coefficients[lane] = coefficient_in_lane(
                    squared[lane], opening[lane], of_lane(length, lane), stiffness,
                    stiffness * of_lane(length, lane), t.step_seconds, time, own.n, lane,
                )  # fmt: skip
                if wp.static(traits.guarded):
                    coefficients[lane] = wp.where(is_self(end, own.item, lane), 0.0, coefficients[lane])
            force = plus_scaled(force, d, coefficients)
        return force

    return pull_of_springs


@cache
def lane_area_loop(traits: Traits) -> Any:
    """The function that sums the area vectors of an item."""
    area_vector_in_faces = area_loop(False, near)

    @wp.func
    def area_vector(t: Any, points: Any, own: Any, springs: Any, point: Lanes3):
        """[m^2]"""
        if wp.static(not traits.quads):
            return area_vector_in_faces(t.fans, points, own.item, point)
        else:
            total = Lanes3()
            for entry in range(t.fans.offsets[own.item], t.fans.offsets[own.item + 1]):
                begin = int_at(t.fans.begins, entry)
                total += cross_at_quad_corner(
                    near(points, entry_at(t.fans.particles, begin + 2)) - point,
                    near(points, entry_at(t.fans.particles, begin + 1)) - point,
                    near(points, entry_at(t.fans.particles, begin)) - point,
                )
            return scaled(total, CROSSES)

    return area_vector


@cache
def lane_loops(traits: Traits, layout: Layout) -> Loops:
    """The loops for an item."""
    places = places_of(layout)
    read_numbers = numbers_reader(traits.columns)
    sum_strings = string_loop(traits) if traits.has("string") else None
    sum_faces = face_loop(traits, places.seen, places.seen) if traits.has("face") else None
    each_looks = traits.has("face") or (traits.has("hinge") and not layout.worlds)
    if_held = traits.has("string") and not each_looks  # few particles are, and what they read takes long
    by_rings = traits.rings and (layout.worlds or traits.balloons == 1)  # places are then the particles' numbers
    load_in_faces = wetness_loop(places.seen) if traits.in_water else None
    load_in_ring = ring_wetness_loop(places.seen) if traits.in_water else None
    level_column = traits.columns.places.get("water_level", 0)
    laws_in_lane = traits.laws_in_lane_on("particle")

    @wp.func
    def particle_of(t: Any, item: wp.int32, lane: wp.int32):
        """The particle that a lane of an item holds; below 0 if it fills up."""
        if wp.static(layout.worlds):
            return item
        else:
            return t.particles[LANE_COUNT * item + lane]

    @wp.func
    def place_of(item: wp.int32, lane: wp.int32):
        """Where it stands among the places that a lane's world is seen at."""
        if wp.static(layout.worlds):
            return item
        else:
            return LANE_COUNT * item + lane

    @wp.func
    def sum_hinges(t: Any, group: wp.int32, place: wp.int32):
        """Of the particle at a place, whose hinges have been bent [N]."""
        pull = wp.vec3()
        for entry in range(t.seen.hinges.particle_offsets[place], t.seen.hinges.particle_offsets[place + 1]):
            of_role = t.hinge_forces[group, t.seen.hinges.particle_roles[entry]]
            pull += wp.vec3(of_role[0], of_role[1], of_role[2])
        return pull

    @wp.func
    def other_pulls(t: Any, points: Any, velocities: Any, own: Any, point: Lanes3, velocity: Lanes3, time: float):
        """Net force of strings, hinges, faces and membranes [N]."""
        force = Lanes3()
        if wp.static(len(traits.membranes) > 0):
            force += of_item(t.membrane_forces[own.group], own.item)
        if wp.static(traits.has("hinge") and layout.worlds):
            of_hinges = t.seen.hinges
            for entry in range(of_hinges.particle_offsets[own.item], of_hinges.particle_offsets[own.item + 1]):
                force += t.hinge_forces[own.group, of_hinges.particle_roles[entry]]
        count = t.lane_count if wp.static(each_looks or if_held) else 0
        if wp.static(if_held and layout.worlds):
            if not is_held(t.all.strings, own.item):
                count = wp.int32(0)
        for lane in range(count):
            particle = particle_of(t, own.item, lane)
            acts = particle >= 0
            if wp.static(if_held and not layout.worlds):
                if acts:
                    acts = is_held(t.all.strings, particle)
            if acts:
                world = places.world(own.group, lane, t.world_count)
                n = read_numbers(t.all, world, own.balloon)
                pull = of_lane(force, lane)
                if wp.static(traits.has("string")):
                    pull += sum_strings(
                        t.all.strings, world, particle, of_lane(point, lane), of_lane(velocity, lane), n,
                        t.step_seconds, time,
                    )  # fmt: skip
                if wp.static(traits.has("hinge") and not layout.worlds):
                    pull += sum_hinges(t, own.group, place_of(own.item, lane))
                if wp.static(traits.has("face")):
                    pull += sum_faces(
                        t.seen, view_of(points, lane), view_of(velocities, lane), world, place_of(own.item, lane), n,
                        time,
                    )  # fmt: skip
                force = set_lane(force, lane, pull)
        return force

    @wp.func
    def water_load(t: Any, points: Any, own: Any):
        """Depth times area vector [m^3], and wetted area [m^2]."""
        loads = Lanes4()
        levels = own.n[level_column]
        for lane in range(t.lane_count):
            view = view_of(points, lane)
            load = wp.vec4()
            if wp.static(by_rings):
                particle = particle_of(t, own.item, lane)
                if particle >= 0:
                    load = load_in_ring(t.all.rings, view, particle, levels[lane], t.up)
            else:
                load = load_in_faces(t.seen.faces, view, place_of(own.item, lane), levels[lane], t.up)
            for number in range(4):
                loads[number, lane] = load[number]
        return loads

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
        """The force with that of the laws on particles [N]."""
        force = Lanes3()
        for lane in range(LANE_COUNT):
            of_one = laws_in_lane(
                position, velocity, mass, mass_share, area_vector, water_load, up, step_seconds, time, n, lane
            )
            force[0, lane] = of_one[0]
            force[1, lane] = of_one[1]
            force[2, lane] = of_one[2]
        return so_far + force

    around = one_after_the_other(traits, lane_spring_loop(traits), lane_area_loop(traits))
    return Loops(around, other_pulls, water_load, particle_laws)
