"""Contacts of small spheres with faces in a substep, found again: each is noted as it comes, one after the other."""

import warp as wp

from balloon_warp.kernels.contact.faces import MOST_LUMPED, MOST_MEETINGS, MOST_SWEEPS, corner_rows
from balloon_warp.kernels.loops.spheres import Course, course_at

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
