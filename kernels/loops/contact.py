"""Contacts of a particle: solids that it may touch, and triangles.

Solids are spheres, the ground, and obstacles. An early test says whether a particle, or any of eight, may come to one;
most do not. Near solids are then checked one by one, so that this test may have false positives, but no false
negatives.

Triangles are of the particle's own balloon or another, see `laws.touch`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import reach_along, scaled, squared_length
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import Lanes, Lanes3, any_negative
from balloon_warp.kernels.laws.contact import (
    MOST_TURNS,
    NEAR_BODY,
    is_settled,
    leave_ground,
    leave_sphere,
    out_of_sphere,
    penalty_force,
)
from balloon_warp.kernels.laws.touch import (
    NEAR,
    across,
    facing,
    nearest_weights,
    quotient,
    reach_gradient,
    share_of_contact,
    touch_friction,
    touch_push,
    weighted,
)
from balloon_warp.kernels.loops.fixtures import (
    GROUND,
    NOBODY,
    ON_GROUND,
    SEVERAL,
    Neighborhood,
    center_function,
    clear_clearance,
    fixture_functions,
    friction_on,
    is_free,
    with_another,
)
from balloon_warp.kernels.loops.spheres import sphere_at
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world, sphere_penalty
from balloon_warp.kernels.warps import add_quanta

WIDER = wp.constant(1.1)
"""(a + b)^2 is at most 1.1 a^2 + 11 b^2: so that no root is needed to see who is near"""
A_STEP = wp.constant(11.0)


@wp.struct
class Solids:
    """Spheres, and after them obstacles, of eight worlds, or of one in all lanes; a row for each group."""

    centers: wp.array2d[Lanes3]
    motions: wp.array2d[Lanes3]
    """Velocities of solids [m/s]"""
    reaches: wp.array2d[Lanes]
    """Squared distances from their centers within which contact is possible [m^2]"""


@cache
def solid_function(features: Features) -> Any:
    """Return the function for center, velocity and squared reach of a sphere or an obstacle."""
    center_at = center_function(features) if features.may_touch_obstacles else None

    @wp.func
    def solid_at(t: Tables, state: WorldState, world: wp.int32, solid: wp.int32, end: float):
        """Return a solid at the end of a step."""
        spheres = state.sphere_positions.shape[1]
        center = wp.vec3()
        motion = wp.vec3()
        reach = float(0.0)
        if solid < spheres:
            place, velocity, radius = sphere_at(t, state, world, solid)
            center = place
            motion = velocity
            reach = radius * radius
            if wp.static(features.impulses):
                reach = (WIDER * NEAR_BODY * NEAR_BODY) * reach
        elif wp.static(center_at is not None):
            center = center_at(t, world, solid - spheres, end)
            reach = t.fixtures.solids[solid - spheres].reach + t.fixtures.fastest * t.step_seconds
            reach = WIDER * reach * reach
        return center, motion, reach

    return solid_at


@cache
def near_function(features: Features) -> Any:
    """Return the function that returns whether any of the particles, which have velocities, may touch a solid."""
    height = features.columns.places["ground_height"]

    @wp.func
    def is_near(t: Any, solids: Solids, params: Any, point: Any, velocity: Any):
        found = bool(False)
        if wp.static(features.ground):
            found = any_negative(reach_along(point, t.up) - params.n[height])
        a_step = A_STEP * t.step_seconds * t.step_seconds
        for solid in range(solids.centers.shape[1]):
            gaps = squared_length(point - solids.centers[params.group, solid]) - solids.reaches[params.group, solid]
            if wp.static(features.impulses or features.may_touch_obstacles):
                gaps = gaps - a_step * squared_length(velocity - solids.motions[params.group, solid])
            found = found or any_negative(gaps)
        return found

    return is_near


@cache
def near_solid_test(features: Features) -> Any:
    """Return the function that returns whether one particle may touch an obstacle or the ground.

    It goes by the particle's last look.
    """
    height = features.columns.places["ground_height"]

    @wp.func
    def may_touch_solid(t: Tables, params: Any, end: float, point: wp.vec3):
        near = params.mass > 0.0 and not is_free(t, params.world, params.number, end, point)
        if wp.static(features.ground):
            near = near or wp.dot(point, t.up) < params.n[height]
        return near

    return may_touch_solid


def near_solids(features: Features, access: Any) -> Any:
    """Return the near-solid test for phases after a particle has moved, of one or of eight.

    A single one is checked only where nothing but obstacles and the ground is left, and looking for obstacles costs
    much.
    """
    if access.world:
        return near_function(features)
    alone = features.may_touch_obstacles and not (features.impulses or features.penalties)
    return near_solid_test(features) if alone else None


def near_solids_ahead(features: Features, access: Any) -> Any:
    """Return the near-solid test for phases before a particle moves, by its expected course."""
    is_near = near_function(features)

    @wp.func
    def is_near_ahead(t: Any, solids: Solids, params: Any, point: Any, predicted_velocity: Any):
        return is_near(t, solids, params, point + scaled(predicted_velocity, t.step_seconds), predicted_velocity)

    return is_near_ahead


@cache
def around_function(features: Features) -> Any:
    """Return the function that returns a particle's surroundings, from its own parameters."""
    height_column = features.columns.places["ground_height"]

    @wp.func
    def around_particle(params: Any, time: float):
        """Return the surroundings of a particle at the end of a step [s]."""
        around = Neighborhood()
        around.world = params.world
        around.particle = params.number
        around.ground_height = params.n[height_column]
        around.balloon = params.balloon
        around.time = time
        return around

    return around_particle


@cache
def solid_contact_function(features: Features) -> Any:
    """Contact of a particle with the ground and obstacles."""
    leave_fixtures = fixture_functions(features)[0] if features.may_touch_obstacles else None

    @wp.func
    def stand(
        t: Tables,
        around: Neighborhood,
        point: wp.vec3,
        velocity: wp.vec3,
    ):
        """Return a particle's point and velocity outside of all obstacles.

        Most particles are above the ground and return at once. Where one obstacle may have pushed it into another, all
        take another turn. If they do not agree, the particle stays at its previous place, outside of resting obstacles.
        Where several have moved it, they begin anew, and stop all of its approach at once.
        """
        start = point - t.step_seconds * velocity
        came = point
        before = velocity
        partner = NOBODY
        at_once = bool(False)
        turns = wp.int32(0)
        while turns < MOST_TURNS:
            turns += 1
            end = point
            again = bool(False)
            if wp.static(features.may_touch_obstacles):
                left, slowed, met, crowded = leave_fixtures(t, around, start, point, velocity, at_once)
                point = left
                velocity = slowed
                again = met != NOBODY and crowded
                partner = with_another(partner, met)
            if wp.static(features.ground):
                if wp.dot(point, t.up) < around.ground_height:
                    friction = friction_on(t, around.world, around.balloon, GROUND)
                    stood, after = leave_ground(
                        point, velocity, t.up, around.ground_height, friction, t.step_seconds, at_once
                    )
                    point = stood
                    velocity = after
                    if wp.static(features.may_touch_obstacles):
                        partner = with_another(partner, ON_GROUND)
                        again = not (
                            is_free(t, around.world, around.particle, around.time, start)
                            and is_free(t, around.world, around.particle, around.time, point)
                        )
            if not again or is_settled(start, end, point):
                turns = MOST_TURNS
            elif wp.static(features.may_touch_obstacles):
                clear_clearance(t, around.world, around.particle)
                if wp.static(not features.fixtures_move):
                    if turns == MOST_TURNS:
                        point = start
            if wp.static(features.may_touch_obstacles):
                if turns == MOST_TURNS and partner == SEVERAL and not at_once:
                    clear_clearance(t, around.world, around.particle)
                    at_once = True
                    turns = 0
                    point = came
                    velocity = before
        return point, velocity

    return stand


@cache
def obstacle_loop(features: Features, sphere_at: Any) -> Any:
    """Return the function that moves a particle out of the ground, obstacles, and by the paper's rule spheres."""
    stand, spheres_there = solid_contact_function(features), features.spheres

    @wp.func
    def leave_obstacles(
        t: Tables,
        spheres: Any,
        around: Neighborhood,
        point: wp.vec3,
        velocity: wp.vec3,
        inflation: wp.vec3,
    ):
        """Return a particle's point and velocity outside of all solids at the end of a step.

        Each sphere gets its force.
        """
        if wp.static(features.penalties):
            for sphere in range(spheres_there):
                center, motion, radius = sphere_at(t, spheres, around.world, sphere)
                if wp.length_sq(point - center) < radius * radius:
                    out, stopped, outward = leave_sphere(point, velocity, center, motion, radius, t.up, t.step_seconds)
                    point = out
                    velocity = stopped
                    push = penalty_force(sphere_penalty(t.spheres, around.world, sphere), inflation, outward)
                    add_quanta(spheres.sphere_quanta, around.world, sphere, push)
        if wp.static(features.stands):
            stood, slowed = stand(t, around, point, velocity)
            point = stood
            velocity = slowed
        return point, velocity

    return leave_obstacles


@cache
def deflection_function(features: Features, sphere_at: Any) -> Any:
    """Predictor of a particle's deflection by obstacles."""
    out_of_fixtures = fixture_functions(features)[1] if features.may_touch_obstacles else None
    spheres_there = features.spheres

    @wp.func
    def deflection_by_obstacles(t: Tables, spheres: Any, around: Neighborhood, point: wp.vec3, velocity: wp.vec3):
        """Return the velocity change of a particle by obstacles in a step, and the normal of the last that it meets.

        Zero if it meets none.
        """
        end = point + t.step_seconds * velocity
        outside = end
        normal = wp.vec3()
        if wp.static(features.spheres > 0):
            for sphere in range(spheres_there):
                center, _motion, radius = sphere_at(t, spheres, around.world, sphere)
                out, outward = out_of_sphere(outside, normal, center, radius, t.up)
                outside = out
                normal = outward
        if wp.static(features.may_touch_obstacles):
            out, outward = out_of_fixtures(t, around, point, outside, velocity, normal)
            outside = out
            normal = outward
        if wp.static(features.ground):
            if wp.dot(outside, t.up) < around.ground_height:
                friction = friction_on(t, around.world, around.balloon, GROUND)
                stood, _slowed = leave_ground(
                    outside, velocity, t.up, around.ground_height, friction, t.step_seconds, False
                )
                outside = stood
                normal = t.up
        return (outside - end) / t.step_seconds, normal

    return deflection_by_obstacles


AS_NEAR = wp.constant(1.0e-5)
"""Relative difference of distance below which two triangles count as equally near, at a shared edge"""
FARTHEST = wp.constant(1.0e30)
"""Squared distance beyond all others [m^2]"""
LITTLE = wp.constant(0.01)
"""Barycentric weight by which a contact may be beyond an edge"""
SOON = wp.constant(2.0)
"""Number of substeps ahead in which a coming contact is counted"""
CAREFUL = wp.constant(0.99)
"""Fraction of a distance that is safe from rounding"""
APART_RATE = wp.constant(10.0)
"""Rate at which an overlap from the start decays [1/s]"""


@wp.struct
class Place:
    """Position of a particle relative to a triangle."""

    weights: wp.vec3  # of the nearest point
    arm: wp.vec3  # from there to the particle [m]
    squared: float  # distance [m^2]
    area_vector: wp.vec3  # twice the triangle's area along its normal [m^2]
    normal: wp.vec3  # n, and
    gap: float  # [m], negative from behind: of the nearest triangle alone, see `faced`


@wp.func
def place_beside(point: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the position of a particle relative to a triangle, without normal and gap."""
    place = Place()
    place.weights = nearest_weights(point, a, b, c)
    place.arm = point - weighted(place.weights, a, b, c)
    place.squared = wp.length_sq(place.arm)
    place.area_vector = wp.cross(b - a, c - a)
    return place


@wp.func
def faced(place: Place, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the position of a particle relative to a triangle, with normal and gap.

    Nothing is overwritten, so that Warp can derive it.
    """
    here = Place()
    here.arm = place.arm
    here.squared = place.squared
    here.area_vector = place.area_vector
    here.normal = facing(place.arm, place.weights, place.area_vector)
    here.gap = wp.dot(place.arm, here.normal)
    # beside an edge, so near that it is taken along the normal: the place met is below it, a little beyond the edge
    beyond = across(place.arm, here.normal)
    more = wp.vec3(
        wp.dot(reach_gradient(here.normal, c - b, place.area_vector), beyond),
        wp.dot(reach_gradient(here.normal, a - c, place.area_vector), beyond),
        wp.dot(reach_gradient(here.normal, b - a, place.area_vector), beyond),
    )
    has_height = wp.length_sq(more) < LITTLE * LITTLE
    here.weights = wp.where(has_height, place.weights + more, place.weights)
    return here


@wp.func
def steepness(place: Place):
    """Return the cosine between the arm and the triangle's normal, from 0 to 1."""
    rise = wp.abs(wp.dot(place.arm, place.area_vector))
    return quotient(rise, wp.length(place.arm) * wp.length(place.area_vector))


@wp.func
def is_nearer(place: Place, other: Place):
    """Return whether a triangle is nearer than another.

    The one of two that faces the particle counts as nearer where they share the closest point: it decides the side.
    """
    if wp.abs(place.squared - other.squared) <= AS_NEAR * other.squared:
        return steepness(place) > steepness(other)
    return place.squared < other.squared


@cache
def skin_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions for the contact's thickness [m] and stiffness [N/m] between two balloons."""
    split = features.columns.balloon_width
    thickness_column = features.columns.places["touch_thickness"] - split
    stiffness_column = features.columns.places["touch_stiffness"] - split

    @wp.func
    def thickness_between(t: Tables, world: wp.int32, first: wp.int32, second: wp.int32):
        said = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), thickness_column]
        thickness = 0.5 * (t.touch.thickness[first] + t.touch.thickness[second])
        return wp.where(said < 0.0, thickness, said)

    @wp.func
    def stiffness_between(t: Tables, world: wp.int32, first: wp.int32, second: wp.int32):
        """Return the contact stiffness of two skins in series, scaled so that two equal ones are as stiff as each."""
        said = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), stiffness_column]
        row = row_of_world(world, t.touch.stiffness.shape[0])
        a = t.touch.stiffness[row, first]
        b = t.touch.stiffness[row, second]
        return wp.where(said < 0.0, quotient(2.0 * a * b, a + b), said)

    return thickness_between, stiffness_between


@wp.struct
class Touching:
    """Parameters of a contact, besides its geometry."""

    side: float  # 1 in front of the triangle, -1 behind it
    thickness: float  # [m]
    stiffness: float  # [N/m]
    friction: float
    crowd: float  # contacts of the busiest of the four, over those that the step allows for
    masses: wp.vec4  # 1 over those of particle and corners [1/kg]
    first: bool  # whether the particle's hold is of this contact
    step_seconds: float


@wp.struct
class ContactForces:
    """The forces on a triangle's corners [N]; that on the particle makes their sum nothing. The hold after it, too."""

    a: wp.vec3
    b: wp.vec3
    c: wp.vec3
    hold: wp.vec4


@wp.func
def what_pushes(pushed: float, overlap: float, approach: float, step_seconds: float):
    """Return the part of an overlap that pushes [m].

    It is the part that came about by moving, so that it has taken the energy that it gives. The rest was there at the
    start, or is there because another triangle, or another side, has become the nearest; it begins to push slowly.

    Args:
        pushed: Part that pushed before [m].
    """
    before = wp.min(pushed, overlap)
    rest = overlap - before
    more = wp.where(approach > -APART_RATE * rest, (APART_RATE * step_seconds) * rest, 0.0)
    come = before + step_seconds * approach + more
    return wp.clamp(come, 0.0, overlap)


@wp.func
def reach_of(place: Place, corners: wp.mat33):
    """Return G of each corner, row by row [1/m].

    Zero where the arm is longer than the triangle is high, which would need excessively large forces.
    """
    first = reach_gradient(place.normal, corners[2] - corners[1], place.area_vector)
    second = reach_gradient(place.normal, corners[0] - corners[2], place.area_vector)
    third = reach_gradient(place.normal, corners[1] - corners[0], place.area_vector)
    steepest = wp.max(wp.max(wp.length_sq(first), wp.length_sq(second)), wp.length_sq(third))
    if place.gap * place.gap * steepest >= 1.0:
        return wp.mat33()
    return wp.matrix_from_rows(first, second, third)


@wp.func
def is_clear(side: float, place: Place, thickness: float, seconds: float, velocity: wp.vec3, moving: wp.mat33):
    """Return whether a particle is so far in front of its nearest triangle that there is no contact now or soon.

    Most particles are, and this test costs less than `comes_at`.

    Args:
        seconds: Time within which a contact counts.
    """
    distance = wp.sqrt(place.squared)
    along_arm = place.squared > NEAR * NEAR * wp.length(place.area_vector)  # where the gap is the distance
    in_front = side * wp.dot(place.arm, place.area_vector) > 0.0
    relative = velocity - weighted(place.weights, moving[0], moving[1], moving[2])
    return along_arm and in_front and CAREFUL * distance > thickness + seconds * wp.length(relative)


@wp.func
def overlap_of(inputs: Touching, place: Place):
    """Return the overlap of a particle with the skin of its triangle [m], negative where there is a gap between."""
    return inputs.thickness - inputs.side * place.gap


@wp.func
def comes_at(inputs: Touching, place: Place, velocity: wp.vec3, moving: wp.mat33):
    """Return whether a particle touches, or will within two substeps at its velocity: such contacts are counted."""
    relative = velocity - weighted(place.weights, moving[0], moving[1], moving[2])
    approach = -inputs.side * wp.dot(relative, place.normal)
    return overlap_of(inputs, place) + SOON * inputs.step_seconds * wp.max(approach, 0.0) > 0.0


@wp.func
def corner_counts(place: Place, corners: wp.mat33):
    """Return the share of each corner of a triangle in a contact's count, by the forces that it bears.

    The particle counts a whole contact.
    """
    reach = reach_of(place, corners)
    arm = wp.abs(place.gap)
    return place.weights + arm * wp.vec3(wp.length(reach[0]), wp.length(reach[1]), wp.length(reach[2]))


@wp.func
def touch(inputs: Touching, place: Place, hold: wp.vec4, velocity: wp.vec3, corners: wp.mat33, moving: wp.mat33):
    """Return the forces of a contact.

    Args:
        hold: State of the particle's contact before.
        corners: Positions of the triangle's corners, row by row [m].
        moving: Velocities of the corners [m/s].
    """
    normal = inputs.side * place.normal
    gap = inputs.side * place.gap
    reach = reach_of(place, corners)
    first = reach[0]
    second = reach[1]
    third = reach[2]
    reaches = wp.ddot(reach, reach) > 0.0
    w = place.weights
    rises = wp.vec3(wp.dot(moving[0], normal), wp.dot(moving[1], normal), wp.dot(moving[2], normal))
    relative = velocity - weighted(w, moving[0], moving[1], moving[2]) + gap * weighted(rises, first, second, third)
    approach = -wp.dot(relative, normal)
    share = share_of_contact(inputs.crowd)
    root = wp.sqrt(share)  # a contact keeps its energy's root, which stays where its share changes
    stiffness = share * inputs.stiffness
    mass = share / (
        inputs.masses[0]
        + w[0] * w[0] * inputs.masses[1]
        + w[1] * w[1] * inputs.masses[2]
        + w[2] * w[2] * inputs.masses[3]
    )
    slip = wp.vec3()
    overlap = wp.min(overlap_of(inputs, place), inputs.thickness)
    if inputs.first:
        overlap = what_pushes(wp.abs(hold[3]) / root, overlap_of(inputs, place), approach, inputs.step_seconds)
        slip = wp.vec3(hold[0], hold[1], hold[2]) / root
    push = touch_push(overlap, approach, stiffness, mass)
    force = push * normal
    forces = ContactForces()
    pull = wp.vec3()
    if reaches:
        slide = across(relative, normal)
        slip = across(slip, normal) + inputs.step_seconds * slide
        pull, slip = touch_friction(slip, slide, inputs.friction * push, stiffness, mass)
        force += pull
    forces.a = -w[0] * force + (gap * wp.dot(first, pull)) * normal
    forces.b = -w[1] * force + (gap * wp.dot(second, pull)) * normal
    forces.c = -w[2] * force + (gap * wp.dot(third, pull)) * normal
    slip *= root
    forces.hold = wp.vec4(slip[0], slip[1], slip[2], inputs.side * wp.max(root * overlap, 1.0e-20))
    return forces
