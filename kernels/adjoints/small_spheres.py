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
from balloon_warp.kernels.adjoints.rolling import motion_pairing
from balloon_warp.kernels.adjoints.spheres import (
    BarsOfSpheres,
    add_by_friction,
    add_by_sphere,
    bar_of_motion,
    put_bar_of_motion,
)
from balloon_warp.kernels.adjoints.sums import mass_adjoint_function
from balloon_warp.kernels.compose import params_functions
from balloon_warp.kernels.contact.spheres import (
    MOST_LUMPED,
    MOST_MEETINGS,
    MOST_SWEEPS,
    add_to_merged,
    changing_function,
    corner_rows,
    faces_function,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import spin_by
from balloon_warp.kernels.laws.touch import (
    facing_of,
    impact,
    longest_displacement,
    part_after,
    part_until_contact,
    seen_at,
)
from balloon_warp.kernels.loops.fixtures import friction_between, number_of_balloon, number_of_sphere
from balloon_warp.kernels.loops.net_force import inertia_function, inverse_mass_function
from balloon_warp.kernels.loops.spheres import MotionState, motion_at, put_motion
from balloon_warp.kernels.phase import Access, Adjoint, Phase
from balloon_warp.kernels.tables import Tables, sphere_mass, sphere_radius
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working

CONTACTS_OF_A_SPHERE = (int(MOST_MEETINGS) + int(MOST_LUMPED)) * int(MOST_SWEEPS)
"""Largest number of contacts with faces in a substep, for each sphere of a world"""
ALONE = wp.constant(-1)
"""Marker of a contact without merged bodies"""


@wp.struct
class FaceContact:
    """A sphere and a triangle as they come to a contact; vectors of corners row by row."""

    sphere: wp.int32
    corners: wp.vec3i
    nearest: float  # part of the radius to which the center may come
    lumped: wp.int32  # number of particles that the sphere moves on with already; `ALONE` where it does not
    motion: MotionState
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
    """Append a contact to the log before it acts."""
    contact = FaceContact()
    contact.sphere = sphere
    contact.corners = corners
    contact.nearest = nearest
    contact.lumped = lumped
    contact.motion = motion_at(spheres, world, sphere)
    contact.points = corner_rows(points, corners)
    contact.velocities = corner_rows(velocities, corners)
    place = spheres.counts[world]
    spheres.contacts[world, place] = contact
    spheres.counts[world] = place + 1


@wp.func
def find_merged_again(working: Working, spheres: LoggedFaces, world: wp.int32, place: wp.int32):
    """Recompute the merged particles up to one of their contacts, and return their number."""
    first = place
    while spheres.contacts[world, first].lumped > 0:
        first -= 1
    count = wp.int32(0)
    for each in range(first, place + 1):
        count = add_to_merged(working.merged[world], count, spheres.contacts[world, each].corners)
    return count


@cache
def merged_adjoint(features: Features) -> Any:
    """Adjoint of a contact of merged bodies, by one thread."""
    _, read_params = params_functions(features.columns, features.balloons)
    inertia = inertia_function(features)

    @wp.func
    def merged_backwards(
        t: Tables, working: Working, spheres: LoggedFaces, bars: Any, world: wp.int32, place: wp.int32
    ):  # fmt: skip
        """Backward pass of merged bodies into the bars of the sphere and corners that came to them.

        Args:
            spheres: as the contact has left them.
        """
        contact = spheres.contacts[world, place]
        sphere = contact.sphere
        start = working.sphere_starts[world, sphere]
        way = spheres.sphere_positions[world, sphere] - start
        velocity = spheres.sphere_velocities[world, sphere]
        count = find_merged_again(working, spheres, world, place)
        bar = bar_of_motion(bars.spheres, world, sphere)
        by_displacement = bar.position
        by_velocity = bar.velocity
        heavy = sphere_mass(t.spheres, world, sphere)
        mass = heavy
        held = bool(False)
        for member in range(count):
            particle = working.merged[world, member]
            by_displacement += bars.points[world, particle]
            by_velocity += bars.velocities[world, particle]
            its_mass = inertia(working, read_params(t, world, particle))
            held = held or its_mass == 0.0
            mass += its_mass
        inverse_mass = wp.where(held, 0.0, 1.0 / mass)
        came = contact.motion.position - start  # its members so far came with the sphere
        going = contact.motion.velocity
        by_mass = inverse_mass * (wp.dot(came - way, by_displacement) + wp.dot(going - velocity, by_velocity))
        add_by_sphere(bars.spheres, world, sphere, by_mass, 0.0)
        bars.spheres.starts[world, sphere] = (
            bars.spheres.starts[world, sphere] + bar.position - inverse_mass * heavy * by_displacement
        )
        bar.position = inverse_mass * heavy * by_displacement
        bar.velocity = inverse_mass * heavy * by_velocity
        put_bar_of_motion(bars.spheres, world, sphere, bar)
        for member in range(count):
            particle = working.merged[world, member]
            its_displacement = came
            its_velocity = going
            if member >= contact.lumped:
                for corner in range(3):
                    if contact.corners[corner] == particle:
                        its_displacement = contact.points[corner] - working.point_starts[world, particle]
                        its_velocity = contact.velocities[corner]
            its_mass = inertia(working, read_params(t, world, particle))
            of_displacement = inverse_mass * its_mass * by_displacement
            by_mass = inverse_mass * (
                wp.dot(its_displacement - way, by_displacement) + wp.dot(its_velocity - velocity, by_velocity)
            )
            bars.starts[world, particle] = bars.starts[world, particle] + bars.points[world, particle] - of_displacement
            bars.points[world, particle] = of_displacement
            bars.velocities[world, particle] = inverse_mass * its_mass * by_velocity
            bars.inverse_masses[world, particle] = bars.inverse_masses[world, particle] - by_mass * its_mass * its_mass

    return merged_backwards


@wp.struct
class ImpactInputs:
    """Inputs of an impact of a sphere and a triangle, or their bars; vectors of corners row by row."""

    start: wp.vec3  # of the center
    motion: MotionState
    radius: float
    mass: float
    starts: wp.mat33
    points: wp.mat33
    velocities: wp.mat33
    inverse_masses: wp.vec3  # inverse masses of the corners [1/kg]
    friction: float


@wp.struct
class ImpactBars:
    """Bars of a sphere's motion state and of places and velocities of three corners, row by row."""

    motion: MotionState
    points: wp.mat33
    velocities: wp.mat33


@wp.func
def facing_when(coming: ImpactInputs):
    """Return the configuration of center and corners before and after a step."""
    return facing_of(coming.start, coming.motion.position, coming.radius, coming.starts, coming.points)


@cache
def impact_pairing_function(features: Features) -> Any:
    """Pairing of the states of sphere and corners after a contact with their bars."""
    change_of = changing_function(features)

    @wp.func
    def impact_pairing(coming: ImpactInputs, part: float, step_seconds: float, bar: ImpactBars):
        inverse_masses = wp.vec4(
            1.0 / coming.mass, coming.inverse_masses[0], coming.inverse_masses[1], coming.inverse_masses[2]
        )
        met = impact(
            facing_when(coming), part, coming.motion.velocity, coming.velocities, inverse_masses, coming.motion.spin,
            coming.friction, step_seconds,
        )  # fmt: skip
        spin = coming.motion.spin
        if wp.static(features.spheres_rub):
            spin += spin_by(coming.mass, coming.radius, wp.cross(met.arm, met.rub))
        shift, gain = change_of(met, 0)
        pairing = motion_pairing(coming.motion.position + shift, coming.motion.velocity + gain, spin, bar.motion)
        for corner in range(3):
            way, more = change_of(met, corner + 1)
            pairing += wp.dot(coming.points[corner] + way, bar.points[corner])
            pairing += wp.dot(coming.velocities[corner] + more, bar.velocities[corner])
        return pairing

    return impact_pairing


@wp.func
def advancement_pairing(coming: ImpactInputs, part: float, nearest: float, by_part: float):
    """Pairing of a step of conservative advancement with its bar."""
    facing = facing_when(coming)
    _weights, arm = seen_at(facing, part)
    return by_part * part_after(part, wp.length(arm), nearest * facing.radius, longest_displacement(facing))


@wp.func
def sum_of_impact_inputs(one: ImpactInputs, other: ImpactInputs):
    """Sum of two bars of impact inputs; the latter are of a step of conservative advancement."""
    one.start += other.start
    one.motion.position += other.motion.position
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
    inverse_masses: wp.array2d[float]
    """Derivatives by the inverse mass of each particle"""
    gas_masses: wp.array2d[float]
    numbers: wp.array3d[float]
    spheres: BarsOfSpheres
    parts: wp.array2d[float]
    """Parts of the step at which a contact was looked for, shape (W, looks)"""


def small_spheres_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Empty adjoint of small spheres and faces: a separate kernel runs them backwards."""
    return ()


@cache
def impact_inputs_function(features: Features) -> Any:
    """Reader of a contact's inputs."""
    inverse_mass_of = inverse_mass_function(features)

    @wp.func
    def impact_inputs_of(t: Tables, working: Working, world: wp.int32, contact: FaceContact):
        corners = contact.corners
        coming = ImpactInputs()
        coming.start = working.sphere_starts[world, contact.sphere]
        coming.motion = contact.motion
        coming.radius = sphere_radius(t.spheres, world, contact.sphere)
        coming.mass = sphere_mass(t.spheres, world, contact.sphere)
        coming.starts = corner_rows(working.point_starts[world], corners)
        coming.points = contact.points
        coming.velocities = contact.velocities
        for corner in range(3):
            coming.inverse_masses[corner] = inverse_mass_of(t, working, world, corners[corner])
        if wp.static(features.spheres_rub):
            balloon = number_of_balloon(t, t.particles.balloon[corners[0]])
            coming.friction = friction_between(t, world, balloon, number_of_sphere(t, contact.sphere))
        return coming

    return impact_inputs_of


@wp.func
def advancement_backwards(
    coming: ImpactInputs, nearest: float, iterations: wp.int32, by_part: float, parts: wp.array[float]
):
    """Adjoint of the conservative advancement to the time of impact."""
    facing = facing_when(coming)
    longest = longest_displacement(facing)
    part = float(0.0)
    for iteration in range(iterations - 1):
        parts[iteration] = part
        _weights, arm = seen_at(facing, part)
        part = part_after(part, wp.length(arm), nearest * facing.radius, longest)
    found = ImpactInputs()
    iteration = iterations - 1
    while iteration > 0:
        iteration -= 1
        by_impact_inputs, by_earlier, _nearest, _by = wp.grad(advancement_pairing)(
            coming, parts[iteration], nearest, by_part
        )
        found = sum_of_impact_inputs(found, by_impact_inputs)
        by_part = by_earlier
    return found


@cache
def contact_adjoint(features: Features) -> Any:
    """Adjoint of a contact, by one thread."""
    impact_inputs_of, impact_pairing = impact_inputs_function(features), impact_pairing_function(features)

    @wp.func
    def contact_back(t: Tables, working: Working, bars: FaceBars, world: wp.int32, contact: FaceContact):
        coming = impact_inputs_of(t, working, world, contact)
        sphere = contact.sphere
        corners = contact.corners
        bar = ImpactBars()
        bar.motion = bar_of_motion(bars.spheres, world, sphere)
        bar.points = corner_rows(bars.points[world], corners)
        bar.velocities = corner_rows(bars.velocities[world], corners)
        facing = facing_when(coming)
        part, iterations = part_until_contact(facing, contact.nearest * facing.radius)
        found, by_part, _step, _bar = wp.grad(impact_pairing)(coming, part, t.step_seconds, bar)
        found = sum_of_impact_inputs(
            found, advancement_backwards(coming, contact.nearest, iterations, by_part, bars.parts[world])
        )
        put_bar_of_motion(bars.spheres, world, sphere, found.motion)
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
            bars.inverse_masses[world, particle] = bars.inverse_masses[world, particle] + found.inverse_masses[corner]

    return contact_back


@cache
def faces_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Backward kernel of contacts of small spheres with faces, which it first recomputes.

    Args:
        columns: of the numbers that are derived by.
    """
    meet_again, merged_backwards = faces_function(features, note_contact), merged_adjoint(features)
    contact_back, mass_adjoint = contact_adjoint(features), mass_adjoint_function(features, columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def turn_faces_back(
        t: Tables, working: Working, spheres: LoggedFaces, all_points: wp.array2d[wp.vec3],
        all_velocities: wp.array2d[wp.vec3], bars: FaceBars,
    ):  # fmt: skip
        """Backward pass of contacts; a block a world.

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
                    merged_backwards(t, working, spheres, bars, world, count)
                put_motion(spheres, world, contact.sphere, contact.motion, True)
        block_barrier()
        if spheres.counts[world] > 0:
            for particle in range(thread, t.particles.balloon.shape[0], wp.block_dim()):
                mass_adjoint(t, working, bars, world, particle)

    return turn_faces_back


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def add_by_starts(bars: FaceBars):
    """Add the derivatives by a particle's place before the substep to those by where the substep begins."""
    world, particle = wp.tid()
    bars.points[world, particle] = bars.points[world, particle] + bars.starts[world, particle]
    bars.starts[world, particle] = wp.vec3()
