"""Adjoint of small spheres that meet faces, a block a world.

A sphere and corners of faces may move on as one. With masses m, ways d and velocities v of all, all have the mean way D
and velocity V. So with the sum b of the derivatives by places after it, those by d are m b / M of the mass M of all,
and by m they are (d - D) . b / M.

Warp derives one contact of a small sphere and a triangle of the law's own functions. The time of impact is derived as
it is found: each look ahead leads to the next. Frozen is how many looks there are, and which branches act.

A substep's contacts are resolved again, and each is noted as it comes. Then one thread goes through them from the last
to the first: each turns the derivatives by a sphere and corners after it into those by their states before it. So all
adds up in one order. Frozen is which faces a sphere meets, in which order, and with which it moves on as one.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.adjoints.rolling import worth
from balloon_warp.kernels.adjoints.spheres import (
    BarsOfSpheres,
    add_by_friction,
    add_by_sphere,
    bar_of_course,
    put_bar_of_course,
)
from balloon_warp.kernels.adjoints.sums import weighing_function
from balloon_warp.kernels.compose import params_functions
from balloon_warp.kernels.contact.spheres import (
    MOST_LUMPED,
    MOST_MEETINGS,
    MOST_SWEEPS,
    add_to_lump,
    changing_function,
    corner_rows,
    faces_function,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import spin_by
from balloon_warp.kernels.laws.touch import facing_of, impact, longest_way, part_after, part_until_contact, seen_at
from balloon_warp.kernels.loops.fixtures import friction_between, number_of_balloon, number_of_sphere
from balloon_warp.kernels.loops.net_force import ease_function, inertia_function
from balloon_warp.kernels.loops.spheres import Course, course_at, put_course
from balloon_warp.kernels.phase import Adjoint, Look, Phase
from balloon_warp.kernels.tables import Tables, sphere_mass, sphere_radius
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working

CONTACTS_OF_A_SPHERE = (int(MOST_MEETINGS) + int(MOST_LUMPED)) * int(MOST_SWEEPS)
"""Largest number of contacts with faces in a substep, for each sphere of a world"""
ALONE = wp.constant(-1)
"""Marker of a contact that is no lump's"""


@wp.struct
class FaceContact:
    """A sphere and a triangle as they come to a contact; vectors of corners row by row."""

    sphere: wp.int32
    corners: wp.vec3i
    nearest: float  # part of the radius to which the center may come
    lumped: wp.int32  # number of particles that the sphere moves on with already; `ALONE` where it does not
    course: Course
    points: wp.mat33
    velocities: wp.mat33


@wp.struct
class LoggedFaces:
    """Spheres of all worlds as faces move them, shape (W, S), and their contacts."""

    sphere_positions: wp.array2d[wp.vec3]
    sphere_velocities: wp.array2d[wp.vec3]
    sphere_spins: wp.array2d[wp.vec3]
    contacts: wp.array2d[FaceContact]
    counts: wp.array[wp.int32]
    """Number of contacts of each world"""


@wp.func
def note_contact(
    spheres: LoggedFaces, world: wp.int32, sphere: wp.int32, nearest: float, lumped: wp.int32, corners: wp.vec3i,
    points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
):  # fmt: skip
    """Note a contact that is about to act."""
    contact = FaceContact()
    contact.sphere = sphere
    contact.corners = corners
    contact.nearest = nearest
    contact.lumped = lumped
    contact.course = course_at(spheres, world, sphere)
    contact.points = corner_rows(points, corners)
    contact.velocities = corner_rows(velocities, corners)
    place = spheres.counts[world]
    spheres.contacts[world, place] = contact
    spheres.counts[world] = place + 1


@wp.func
def lump_again(working: Working, spheres: LoggedFaces, world: wp.int32, place: wp.int32):
    """Find the particles of a lump again, up to one of its contacts, and return their number."""
    first = place
    while spheres.contacts[world, first].lumped > 0:
        first -= 1
    count = wp.int32(0)
    for each in range(first, place + 1):
        count = add_to_lump(working.lumps[world], count, spheres.contacts[world, each].corners)
    return count


@cache
def lump_adjoint(features: Features) -> Any:
    """Return the function that runs a contact of a lump backwards, by one thread."""
    _, read_params = params_functions(features.columns, features.balloons)
    inertia = inertia_function(features)

    @wp.func
    def lump_back(
        t: Tables, working: Working, spheres: LoggedFaces, bars: Any, world: wp.int32, place: wp.int32
    ):  # fmt: skip
        """Turn the derivatives by a lump into those by the sphere and corners that came to it.

        Args:
            spheres: as the contact has left them.
        """
        contact = spheres.contacts[world, place]
        sphere = contact.sphere
        start = working.sphere_starts[world, sphere]
        way = spheres.sphere_positions[world, sphere] - start
        velocity = spheres.sphere_velocities[world, sphere]
        count = lump_again(working, spheres, world, place)
        bar = bar_of_course(bars.spheres, world, sphere)
        by_way = bar.position
        by_velocity = bar.velocity
        heavy = sphere_mass(t.spheres, world, sphere)
        mass = heavy
        held = bool(False)
        for member in range(count):
            particle = working.lumps[world, member]
            by_way += bars.points[world, particle]
            by_velocity += bars.velocities[world, particle]
            its_mass = inertia(working, read_params(t, world, particle))
            held = held or its_mass == 0.0
            mass += its_mass
        ease = wp.where(held, 0.0, 1.0 / mass)
        came = contact.course.position - start  # its members so far came with the sphere
        going = contact.course.velocity
        by_mass = ease * (wp.dot(came - way, by_way) + wp.dot(going - velocity, by_velocity))
        add_by_sphere(bars.spheres, world, sphere, by_mass, 0.0)
        bars.spheres.starts[world, sphere] = bars.spheres.starts[world, sphere] + bar.position - ease * heavy * by_way
        bar.position = ease * heavy * by_way
        bar.velocity = ease * heavy * by_velocity
        put_bar_of_course(bars.spheres, world, sphere, bar)
        for member in range(count):
            particle = working.lumps[world, member]
            its_way = came
            its_velocity = going
            if member >= contact.lumped:
                for corner in range(3):
                    if contact.corners[corner] == particle:
                        its_way = contact.points[corner] - working.point_starts[world, particle]
                        its_velocity = contact.velocities[corner]
            its_mass = inertia(working, read_params(t, world, particle))
            of_way = ease * its_mass * by_way
            by_mass = ease * (wp.dot(its_way - way, by_way) + wp.dot(its_velocity - velocity, by_velocity))
            bars.starts[world, particle] = bars.starts[world, particle] + bars.points[world, particle] - of_way
            bars.points[world, particle] = of_way
            bars.velocities[world, particle] = ease * its_mass * by_velocity
            bars.eases[world, particle] = bars.eases[world, particle] - by_mass * its_mass * its_mass

    return lump_back


@wp.struct
class Coming:
    """A sphere and a triangle as they come to a contact, or derivatives by that; vectors of corners row by row."""

    start: wp.vec3  # of the center
    course: Course
    radius: float
    mass: float
    starts: wp.mat33
    points: wp.mat33
    velocities: wp.mat33
    eases: wp.vec3  # inverse masses of the corners [1/kg]
    friction: float


@wp.struct
class Worth:
    """Derivatives by a sphere's course and by places and velocities of three corners, row by row."""

    course: Course
    points: wp.mat33
    velocities: wp.mat33


@wp.func
def facing_when(coming: Coming):
    """Return the configuration of center and corners before and after a step."""
    return facing_of(coming.start, coming.course.position, coming.radius, coming.starts, coming.points)


@cache
def impact_work(features: Features) -> Any:
    """Return the function of the states of sphere and corners after a contact, times the derivatives by these."""
    change_of = changing_function(features)

    @wp.func
    def work_of_impact(coming: Coming, part: float, step_seconds: float, bar: Worth):
        eases = wp.vec4(1.0 / coming.mass, coming.eases[0], coming.eases[1], coming.eases[2])
        met = impact(
            facing_when(coming), part, coming.course.velocity, coming.velocities, eases, coming.course.spin,
            coming.friction, step_seconds,
        )  # fmt: skip
        spin = coming.course.spin
        if wp.static(features.spheres_rub):
            spin += spin_by(coming.mass, coming.radius, wp.cross(met.arm, met.rub))
        shift, gain = change_of(met, 0)
        work = worth(coming.course.position + shift, coming.course.velocity + gain, spin, bar.course)
        for corner in range(3):
            way, more = change_of(met, corner + 1)
            work += wp.dot(coming.points[corner] + way, bar.points[corner])
            work += wp.dot(coming.velocities[corner] + more, bar.velocities[corner])
        return work

    return work_of_impact


@wp.func
def work_of_look(coming: Coming, part: float, nearest: float, by_part: float):
    """Return until which part of the step they cannot meet, as it is seen at a part before, times its derivative."""
    facing = facing_when(coming)
    _weights, arm = seen_at(facing, part)
    return by_part * part_after(part, wp.length(arm), nearest * facing.radius, longest_way(facing))


@wp.func
def sum_of_comings(one: Coming, other: Coming):
    """Return the sum of derivatives, of which the latter are those of a look."""
    one.start += other.start
    one.course.position += other.course.position
    one.radius += other.radius
    one.starts += other.starts
    one.points += other.points
    return one


@wp.struct
class FaceBars:
    """Derivatives by small spheres and faces that meet."""

    points: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    starts: wp.array2d[wp.vec3]
    """Derivatives by the places of particles before the substep"""
    eases: wp.array2d[float]
    """Derivatives by the inverse mass of each particle"""
    gas_masses: wp.array2d[float]
    numbers: wp.array3d[float]
    spheres: BarsOfSpheres
    parts: wp.array2d[float]
    """Parts of the step at which a contact was looked for, shape (W, looks)"""


def small_spheres_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return no adjoint of small spheres and faces: a kernel of its own runs them backwards."""
    return ()


@cache
def coming_function(features: Features) -> Any:
    """Return the function that reads all that a contact depends on."""
    ease_of_moving = ease_function(features)

    @wp.func
    def coming_of(t: Tables, working: Working, world: wp.int32, contact: FaceContact):
        corners = contact.corners
        coming = Coming()
        coming.start = working.sphere_starts[world, contact.sphere]
        coming.course = contact.course
        coming.radius = sphere_radius(t.spheres, world, contact.sphere)
        coming.mass = sphere_mass(t.spheres, world, contact.sphere)
        coming.starts = corner_rows(working.point_starts[world], corners)
        coming.points = contact.points
        coming.velocities = contact.velocities
        for corner in range(3):
            coming.eases[corner] = ease_of_moving(t, working, world, corners[corner])
        if wp.static(features.spheres_rub):
            balloon = number_of_balloon(t, t.particles.balloon[corners[0]])
            coming.friction = friction_between(t, world, balloon, number_of_sphere(t, contact.sphere))
        return coming

    return coming_of


@wp.func
def looks_back(coming: Coming, nearest: float, looks: wp.int32, by_part: float, parts: wp.array[float]):
    """Return the derivatives by all that the time of impact was found from."""
    facing = facing_when(coming)
    longest = longest_way(facing)
    part = float(0.0)
    for look in range(looks - 1):
        parts[look] = part
        _weights, arm = seen_at(facing, part)
        part = part_after(part, wp.length(arm), nearest * facing.radius, longest)
    found = Coming()
    look = looks - 1
    while look > 0:
        look -= 1
        by_coming, by_earlier, _nearest, _by = wp.grad(work_of_look)(coming, parts[look], nearest, by_part)
        found = sum_of_comings(found, by_coming)
        by_part = by_earlier
    return found


@cache
def contact_adjoint(features: Features) -> Any:
    """Return the function that runs a contact backwards, by one thread."""
    coming_of, work_of_impact = coming_function(features), impact_work(features)

    @wp.func
    def contact_back(t: Tables, working: Working, bars: FaceBars, world: wp.int32, contact: FaceContact):
        coming = coming_of(t, working, world, contact)
        sphere = contact.sphere
        corners = contact.corners
        bar = Worth()
        bar.course = bar_of_course(bars.spheres, world, sphere)
        bar.points = corner_rows(bars.points[world], corners)
        bar.velocities = corner_rows(bars.velocities[world], corners)
        facing = facing_when(coming)
        part, looks = part_until_contact(facing, contact.nearest * facing.radius)
        found, by_part, _step, _bar = wp.grad(work_of_impact)(coming, part, t.step_seconds, bar)
        found = sum_of_comings(found, looks_back(coming, contact.nearest, looks, by_part, bars.parts[world]))
        put_bar_of_course(bars.spheres, world, sphere, found.course)
        bars.spheres.starts[world, sphere] = bars.spheres.starts[world, sphere] + found.start
        add_by_sphere(bars.spheres, world, sphere, found.mass, found.radius)
        if wp.static(features.spheres_rub):
            balloon = number_of_balloon(t, t.particles.balloon[corners[0]])
            add_by_friction(bars.spheres, world, balloon, number_of_sphere(t, sphere), found.friction)
        for corner in range(3):
            particle = corners[corner]
            bars.points[world, particle] = found.points[corner]
            bars.velocities[world, particle] = found.velocities[corner]
            bars.starts[world, particle] = bars.starts[world, particle] + found.starts[corner]
            bars.eases[world, particle] = bars.eases[world, particle] + found.eases[corner]

    return contact_back


@cache
def faces_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the kernel that runs small spheres and faces backwards, after it has let them meet again.

    Args:
        columns: of the numbers that are derived by.
    """
    meet_again, lump_back = faces_function(features, note_contact), lump_adjoint(features)
    contact_back, weigh_back = contact_adjoint(features), weighing_function(features, columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def turn_faces_back(
        t: Tables, working: Working, spheres: LoggedFaces, all_points: wp.array2d[wp.vec3],
        all_velocities: wp.array2d[wp.vec3], bars: FaceBars,
    ):  # fmt: skip
        """Turn the derivatives by the state after contacts into those by the state before; a block a world.

        Args:
            spheres: as they come to faces; they are moved again, as are the next two.
        """
        world, thread = wp.tid()
        if thread == 0:
            spheres.counts[world] = 0
        block_barrier()
        meet_again(t, spheres, working, world, thread, all_points[world], all_velocities[world])
        block_barrier()
        if thread == 0:
            count = spheres.counts[world]
            while count > 0:
                count -= 1
                contact = spheres.contacts[world, count]
                if contact.lumped == ALONE:
                    contact_back(t, working, bars, world, contact)
                else:
                    lump_back(t, working, spheres, bars, world, count)
                put_course(spheres, world, contact.sphere, contact.course, True)
        block_barrier()
        if spheres.counts[world] > 0:
            for particle in range(thread, t.particles.balloon.shape[0], wp.block_dim()):
                weigh_back(t, working, bars, world, particle)

    return turn_faces_back


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def add_by_starts(bars: FaceBars):
    """Add the derivatives by a particle's place before the substep to those by where the substep begins."""
    world, particle = wp.tid()
    bars.points[world, particle] = bars.points[world, particle] + bars.starts[world, particle]
    bars.starts[world, particle] = wp.vec3()
