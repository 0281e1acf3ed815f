"""Forces on particles: of springs, membranes that wear and tear, faces, liquids, and outer ones.

Membranes wear and tear before they pull: stresses of faces, the start of tears, and their propagation precede the
forces of a substep and follow the stresses of triangles. Each whole face looks for tears that arrive, and tears in a
launch of its own, so that the order of threads does not matter.

`push_face` and its like find forces by atomic adds into one array that particles take: the readable reference, which
every other way is tested against.

`pull` sums the net force on a particle but for the inflation's: of springs, strings, hinges, faces, membranes and laws
on particles; the thrust of jets, and the forces of contacts.

Where one thread has a whole world, each triangle, hinge and face is evaluated once, and its forces wait at the
particles.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.gas import jet_backwards
from balloon_warp.kernels.adjoints.membranes import quads_backwards
from balloon_warp.kernels.adjoints.pull import (
    add_backwards,
    add_face_forces_backwards,
    find_water_load_backwards,
    pull_backwards,
)
from balloon_warp.kernels.compose import function_from, numbers_reader
from balloon_warp.kernels.contact.response import take_contact_forces
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import any_positive, entry_at
from balloon_warp.kernels.laws.membrane import WHOLE, across_tension, branch_plane, cuts, normal_of, plane_through
from balloon_warp.kernels.laws.springs import FIRST_WING
from balloon_warp.kernels.loops.areas import corner_area, face_measures
from balloon_warp.kernels.loops.gas import hole_jet_loop, jet_loop
from balloon_warp.kernels.loops.membranes import of_balloon, triangle_pull, wear_of_triangle
from balloon_warp.kernels.loops.net_force import (
    face_push,
    held_string_pull,
    hinge_forces,
    net_force_function,
    outer_force,
    push_of_faces_function,
    wing_size,
)
from balloon_warp.kernels.loops.quads import quad_pull, quad_wear
from balloon_warp.kernels.loops.springs import pair_pull
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.phase import Access, nothing, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working


def _has_membranes(features: Features) -> bool:
    return bool(features.membranes)


@phase("world", when=_has_membranes, once=lambda features: True)
def clear(features: Features, access: Access) -> Any:
    """Clear the unused entries of particles that have fewer faces than others."""
    return access.membrane_faces(features).clear


@phase("membrane_face", when=_has_membranes)
def stretch(features: Features, access: Access) -> Any:
    """Measure a face, and store its forces at its corners."""
    if access.membrane_faces(features).keeps:
        return access.membrane_faces(features).stretch
    stretch_face = access.membrane_faces(features).stretch

    @wp.func
    def stretch(t: Tables, world: wp.int32, membrane_face: wp.int32, points: Any, pulls: Any, area_vectors: Any):
        stretch_face(t, world, membrane_face, points, points, pulls, area_vectors)

    @wp.func
    def stretch_by_velocities(
        t: Tables, world: wp.int32, membrane_face: wp.int32, points: Any, velocities: Any, pulls: Any, area_vectors: Any
    ):
        stretch_face(t, world, membrane_face, points, velocities, pulls, area_vectors)

    return stretch_by_velocities if features.viscous else stretch


@phase("particle", {"skin": Any}, when=_has_membranes)
def collect(features: Features, access: Access) -> Any:
    """Sum the forces of its faces on a particle."""
    return access.membrane_faces(features).collect


LAST_FACE = wp.constant(wp.int64(2**31 - 1))
SQUARE_MICROMETERS = wp.constant(wp.float64(1.0e12))
"""Square micrometers in a square meter"""
center_of_face, area_vector_of_face = face_measures(vector_at)


@wp.func
def packed(stress: float, face: wp.int32):
    """Return stress and face as one number, whose maximum is the greatest stress, or the first face that has it."""
    bits = wp.int64(wp.cast(wp.max(stress, 0.0), wp.uint32))
    return (bits << wp.int64(32)) + LAST_FACE - wp.int64(face)


@wp.func
def unpacked(number: wp.int64):
    """Unpack the stress [Pa]."""
    return wp.cast(wp.uint32(number >> wp.int64(32)), wp.float32)


@wp.func
def face_of(number: wp.int64):
    """Read the face of an entry."""
    return wp.int32(LAST_FACE - (number & LAST_FACE))


@wp.func
def is_gone(torn: wp.array2d[float], world: wp.int32, face: wp.int32):
    return torn[world, face] >= 0.0


@phase("face", when=lambda features: features.bursts)
@wp.func
def find_skin_stress(t: Tables, state: WorldState, world: wp.int32, face: wp.int32, time: float):
    """Find the stress of a face, and whether the balloon is to burst there.

    A torn face has no tension.
    """
    tears = t.membranes.wear.tears
    begin = tears.triangle_offsets[face]
    end = tears.triangle_offsets[face + 1]
    gone = is_gone(state.torn, world, face)
    tears.gone[world, face] = wp.where(gone, wp.int8(1), wp.int8(0))
    stress = float(0.0)
    for entry in range(begin, end):
        triangle = tears.triangles[entry]
        stress += tears.stresses[world, triangle]
        if gone:
            t.membranes.wear.left[world, triangle] = 0.0
    stress /= wp.max(float(end - begin), 1.0)
    tears.face_stresses[world, face] = stress
    balloon = t.faces.balloon[face]
    if end > begin and not gone and state.bursts[world, balloon][0] < 0.0:
        pierced = time >= of_balloon(tears.needle_time, world, balloon)
        if pierced or stress >= of_balloon(tears.film_strength, world, balloon):
            wp.atomic_max(tears.weakest, world, balloon, packed(stress, face))


@wp.func
def is_cut(t: Tables, plane: wp.vec4, edge: wp.vec2i):
    """Return whether a tear's plane cuts an edge."""
    rests = t.membranes.wear.tears.rests
    return cuts(plane, rests[edge[0]], rests[edge[1]])


@wp.func
def middle_of(t: Tables, edge: wp.vec2i):
    """Return the midpoint of an edge on the unstretched skin."""
    rests = t.membranes.wear.tears.rests
    return 0.5 * (rests[edge[0]] + rests[edge[1]])


@wp.func
def branch_of(t: Tables, plane: wp.vec4, burst: wp.vec4, world: wp.int32, face: wp.int32):
    """Find the entry of the neighbor to which a tear branches off from a torn face, or -1.

    It branches where it begins, and each time that it has gone as far again from there.
    """
    tears = t.membranes.wear.tears
    balloon = t.faces.balloon[face]
    if burst[3] <= of_balloon(tears.branching_stress, world, balloon):
        return wp.int32(-1)
    first = wp.int32(burst[2])
    nearest = float(1.0e30)
    farthest = float(0.0)
    flank = wp.int32(-1)
    for entry in range(tears.neighbor_offsets[face], tears.neighbor_offsets[face + 1]):
        edge = tears.edges[entry]
        if is_cut(t, plane, edge):
            way = wp.length(middle_of(t, edge) - tears.centers[first]) / tears.ways[balloon]
            nearest = wp.min(nearest, way)
            farthest = wp.max(farthest, way)
        elif flank < 0 or (face & 1) == 1:
            flank = entry + 0
    times = wp.min(wp.int32(farthest), tears.branchings[balloon] - 1)
    if (face == first and tears.branchings[balloon] > 0) or (times > 0 and nearest < float(times)):
        return flank
    return wp.int32(-1)


@wp.func
def tear_across(
    t: Tables,
    burst: wp.vec4,
    torn: wp.array2d[float],
    planes: wp.array2d[wp.vec4],
    world: wp.int32,
    face: wp.int32,
    entry: wp.int32,
):
    """Return the distance of a neighbor's tear beyond a face [m], negative if it does not reach it, and its plane."""
    tears = t.membranes.wear.tears
    other = tears.neighbors[entry]
    reach = torn[world, other]
    plane = planes[world, other]
    edge = tears.edges[entry]
    if reach < 0.0:
        return WHOLE, plane
    step = tears.centers[face] - tears.centers[other]
    heading = wp.cross(normal_of(plane), tears.normals[other])
    begins = other == wp.int32(burst[2])
    if is_cut(t, plane, edge):
        if begins and wp.dot(heading, step) < 0.0:  # it runs both ways from there
            plane = -plane
        across = wp.dot(normal_of(plane), step)
        return reach - wp.sqrt(wp.max(wp.length_sq(step) - across * across, 0.0)), plane
    branch = branch_of(t, plane, burst, world, other)
    if branch < 0:
        return WHOLE, plane
    if tears.neighbors[branch] != face:
        return WHOLE, plane
    if begins:
        heading = wp.vec3()
    return reach - wp.length(step), branch_plane(heading, step, tears.normals[face], middle_of(t, edge))


@wp.func
def first_plane(t: Tables, points: wp.array[wp.vec3], face: wp.int32):
    """Return the plane of a tear that begins in a face: across the largest tension."""
    tears = t.membranes.wear.tears
    a = t.faces.particles[t.faces.offsets[face]]
    b = t.faces.particles[t.faces.offsets[face] + 1]
    c = t.faces.particles[t.faces.offsets[face] + 2]
    normal = across_tension(
        tears.rests[b] - tears.rests[a], tears.rests[c] - tears.rests[a], points[b] - points[a], points[c] - points[a]
    )
    return plane_through(normal, tears.centers[face])


@phase("face", when=lambda features: features.bursts)
@wp.func
def run(t: Tables, state: WorldState, points: wp.array[wp.vec3], world: wp.int32, face: wp.int32):
    """Find whether a tear begins at a face, or arrives there."""
    tears = t.membranes.wear.tears
    tears.ahead[world, face] = WHOLE
    if is_gone(state.torn, world, face):
        return
    balloon = t.faces.balloon[face]
    burst = state.bursts[world, balloon]
    stress = tears.face_stresses[world, face]
    if burst[0] < 0.0:
        weakest = tears.weakest[world, balloon]
        if weakest > wp.int64(0) and weakest == packed(stress, face):
            tears.ahead[world, face] = 0.0
            state.tear_planes[world, face] = first_plane(t, points, face)
    elif stress > of_balloon(tears.tear_strength, world, balloon):
        for entry in range(tears.neighbor_offsets[face], tears.neighbor_offsets[face + 1]):
            if tears.ahead[world, face] < 0.0:
                ahead, plane = tear_across(t, burst, state.torn, state.tear_planes, world, face, entry)
                if ahead >= 0.0:
                    most = of_balloon(tears.tear_speed, world, balloon) * t.step_seconds
                    tears.ahead[world, face] = wp.min(ahead, most)  # however long it has waited
                    state.tear_planes[world, face] = plane


@wp.func
def area_of(t: Tables, points: wp.array[wp.vec3], face: wp.int32):
    """Return the current area of a face, in square micrometers."""
    area = wp.length(area_vector_of_face(t.faces, points, face, center_of_face(t.faces, points, face)))
    return wp.int64(wp.float64(area) * SQUARE_MICROMETERS)


@phase("face", when=lambda features: features.bursts)
@wp.func
def tear(t: Tables, state: WorldState, points: wp.array[wp.vec3], world: wp.int32, face: wp.int32):
    """Tear a face that a tear has reached, and let other tears advance."""
    tears = t.membranes.wear.tears
    balloon = t.faces.balloon[face]
    gone = is_gone(state.torn, world, face)
    if gone:
        state.torn[world, face] += of_balloon(tears.tear_speed, world, balloon) * t.step_seconds
    elif tears.ahead[world, face] >= 0.0:
        state.torn[world, face] = tears.ahead[world, face]
        tears.gone[world, face] = wp.int8(1)
        for entry in range(tears.triangle_offsets[face], tears.triangle_offsets[face + 1]):
            t.membranes.wear.left[world, tears.triangles[entry]] = 0.0
        gone = bool(True)
    if gone or state.bursts[world, balloon][0] >= 0.0:
        wp.atomic_add(tears.areas, world, balloon, wp.where(gone, 0, 1), area_of(t, points, face))


def _may_wear(scene: Any) -> bool:
    """Return whether a balloon is of rubber that softens, or tears."""
    materials = [balloon.material for balloon in scene.balloon]
    return any(each.softening is not None or each.strength is not None for each in materials)


@cache
def wear_of_points(features: Features, at: Any) -> Any:
    """Make the function that finds the factor on the tension of triangles, and their stresses.

    It returns the greatest energy density so far [Pa].
    """
    read_numbers, wear_of_metric = numbers_reader(features.columns), wear_of_triangle(features)

    @wp.func
    def wear(t: Tables, points: Any, world: wp.int32, triangle: wp.int32, peak: float):
        corners = t.membranes.corners[triangle]
        balloon = t.particles.balloon[corners[0]]
        d1 = at(points, corners[1]) - at(points, corners[0])
        d2 = at(points, corners[2]) - at(points, corners[0])
        metric = wp.vec3(wp.dot(d1, d1), wp.dot(d1, d2), wp.dot(d2, d2))
        left, greatest, stress = wear_of_metric(
            t, world, balloon, t.membranes.materials[balloon], metric, t.membranes.corner_rests[triangle], peak,
            read_numbers(t, world, balloon), 0,
        )  # fmt: skip
        t.membranes.wear.left[world, triangle] = left
        if wp.static(features.bursts):
            t.membranes.wear.tears.stresses[world, triangle] = stress
        return greatest

    return wear


@phase("triangle", {"peak": float}, wants=_may_wear, keeps={"peak": 0.0})
def wear(features: Features, access: Access) -> Any:
    """Find the factor on a triangle's tension, and its peak stretch."""
    return wear_of_points(features, access.at)


@phase("triangle", when=lambda features: features.wears)
def evaluate_wear(features: Features, access: Access) -> Any:
    """Find the factor on a triangle's tension, without keeping its peak stretch."""
    wear = wear_of_points(features, access.at)

    @wp.func
    def evaluate_wear(t: Tables, points: Any, world: wp.int32, triangle: wp.int32, peak: float):
        wear(t, points, world, triangle, peak)

    return evaluate_wear


@cache
def hinge_function(features: Features, at: Any, add: Any) -> Any:
    """Make the function that adds the forces of a hinge.

    Args:
        at: the function that reads a point.
        add: the one that adds a force to a particle's.
    """
    forces_of_hinge, read_numbers = hinge_forces(features, at), numbers_reader(features.columns)

    @wp.func
    def add_hinge(t: Tables, world: wp.int32, hinge: wp.int32, points: Any, forces: Any):
        """Add forces on its two ends and on the corners of its wings."""
        ends = t.hinges.ends[hinge]
        of_roles = forces_of_hinge(t.hinges, points, hinge, read_numbers(t, world, t.particles.balloon[ends[0]]))
        add(forces, ends[0], of_roles[0])
        add(forces, ends[1], of_roles[1])
        for wing in range(2):
            begin = t.hinges.wing_offsets[2 * hinge + wing]
            for corner in range(begin, begin + wing_size(t.hinges, hinge, wing)):
                add(forces, t.hinges.wing_particles[corner], of_roles[FIRST_WING + wing])

    return add_hinge


@cache
def surface_functions(features: Features, at: Any) -> tuple[Any, Any]:
    """Make the functions that add the forces of a membrane's triangle, and of a face, to a world's."""
    push_at_corner = face_push(features, at, vector_at)
    read_numbers = numbers_reader(features.columns)
    pull_of_triangle = triangle_pull(features) if features.membranes else None

    @wp.func
    def add_triangle(t: Tables, world: wp.int32, triangle: wp.int32, points: Any, velocities: Any, forces: Any):
        """Add a membrane triangle's forces to its three corners."""
        corners = t.membranes.corners[triangle]
        p = corners[0]
        balloon = t.particles.balloon[p]
        n = read_numbers(t, world, balloon)
        pull, first, second = pull_of_triangle(
            points[corners[1]] - points[p], points[corners[2]] - points[p],
            velocities[corners[1]] - velocities[p], velocities[corners[2]] - velocities[p],
            t.membranes.corner_rests[triangle], t.membranes.materials[balloon], n,
        )  # fmt: skip
        if wp.static(features.wears):
            left = t.membranes.wear.left[world, triangle]
            pull *= left
            first *= left
            second *= left
        wp.atomic_add(forces, p, pull)
        wp.atomic_add(forces, corners[1], first)
        wp.atomic_add(forces, corners[2], second)

    @wp.func
    def add_face(t: Tables, world: wp.int32, face: wp.int32, points: Any, velocities: Any, time: float, forces: Any):
        """Add a face's force to its corners, in equal shares."""
        share = push_at_corner(t, points, velocities, world, face, time)
        for corner in range(t.faces.offsets[face], t.faces.offsets[face + 1]):
            wp.atomic_add(forces, t.faces.particles[corner], share)

    return add_triangle, add_face


@phase("element")
def add_forces(features: Features, access: Access) -> Any:
    """Add the forces of a spring, or string, or hinge, or triangle, or face on its particles, in this order."""
    add_hinge = hinge_function(features, access.at, access.add)
    add_triangle, add_face = surface_functions(features, access.at)
    pull_of_pair, pull_of_held_string = pair_pull(features), held_string_pull(features)

    @wp.func
    def add_spring(
        t: Tables, world: wp.int32, spring: wp.int32, points: Any, velocities: Any, time: float, forces: Any
    ):
        """Add a spring's equal and opposite forces to its two particles."""
        d, coefficient = pull_of_pair(t, world, spring, points, velocities, time)
        wp.atomic_add(forces, t.pairs.particles[spring][0], d * coefficient)
        wp.atomic_sub(forces, t.pairs.particles[spring][1], d * coefficient)

    @wp.func
    def add_string(t: Tables, world: wp.int32, held: wp.int32, points: Any, velocities: Any, time: float, forces: Any):
        """Add a string's force to its particle."""
        pull = pull_of_held_string(t, world, held, points, velocities, time)
        wp.atomic_add(forces, t.strings.particles[held], pull)

    @wp.func
    def add_forces(
        t: Tables, working: Working, points: Any, velocities: Any, world: wp.int32, element: wp.int32, time: float
    ):
        forces = working.forces[world]
        first_string = t.pairs.kinds.shape[0]
        first_hinge = first_string + t.strings.particles.shape[0]
        first_triangle = first_hinge + t.hinges.ends.shape[0]
        first_face = first_triangle + t.membranes.corners.shape[0]
        if element < first_string:
            add_spring(t, world, element, points, velocities, time, forces)
        elif element < first_hinge:
            if wp.static(features.has("string")):
                add_string(t, world, element - first_string, points, velocities, time, forces)
        elif element < first_triangle:
            if wp.static(features.has("hinge")):
                add_hinge(t, world, element - first_hinge, points, forces)
        elif element < first_face:
            if wp.static(bool(features.membranes)):
                add_triangle(t, world, element - first_triangle, points, velocities, forces)
        else:
            if wp.static(features.has("face")):
                add_face(t, world, element - first_face, points, velocities, time, forces)

    return add_forces


area_vector_at_corner = corner_area(vector_at)


@phase("face", when=lambda features: features.measures_areas)
@wp.func
def add_area_vectors(t: Tables, working: Working, points: wp.array[wp.vec3], world: wp.int32, face: wp.int32):
    """Add a face's parts of the area vectors of its particles."""
    for corner in range(t.faces.offsets[face + 1] - t.faces.offsets[face]):
        particle = t.faces.particles[t.faces.offsets[face] + corner]
        part = area_vector_at_corner(t, points, face, corner, points[particle])
        wp.atomic_add(working.area_vectors, world, particle, part)


@wp.func
def is_driven(t: Any, params: Any):
    """Return whether an outer force drives any particle of eight."""
    return any_positive(t.outer.slots[params.number, 0])


@phase(
    "particle",
    {"force": wp.vec3},
    when=lambda features: features.driven,
    rare=lambda features, access: is_driven,
    adjoint=add_backwards,
)
@wp.func
def add_outer_forces(t: Tables, params: Any, force: wp.vec3):
    """Add the outer forces on groups of particles."""
    return force + outer_force(t.outer, params.world, params.number)


def _acts_on_faces(features: Features) -> bool:
    return features.has("face")


@phase("face", {"face_push": wp.vec3}, when=_acts_on_faces, adjoint=nothing)
def push_face(features: Features, access: Access) -> Any:
    """Find the force on a face, each corner's share [N]."""
    push_at_corner = face_push(features, access.at, access.velocity_at)

    @wp.func
    def push_face(t: Tables, world: wp.int32, face: wp.int32, points: Any, time: float):
        return push_at_corner(t, points, points, world, face, time)

    @wp.func
    def push_by_velocities(t: Tables, world: wp.int32, face: wp.int32, points: Any, velocities: Any, time: float):
        return push_at_corner(t, points, velocities, world, face, time)

    return push_by_velocities if features.needs("face", "velocity") else push_face


@phase("particle", {"force": wp.vec3}, when=_acts_on_faces, adjoint=add_face_forces_backwards)
def add_face_forces(features: Features, access: Access) -> Any:
    """Add the forces on its faces to a particle."""
    push_of_faces = push_of_faces_function(features)

    @wp.func
    def add_face_forces(t: Tables, face_pushes: Any, particle: wp.int32, force: wp.vec3):
        return force + push_of_faces(t, face_pushes, particle)

    return add_face_forces


@phase("particle", {"water_load": wp.vec4}, when=lambda features: features.in_water, adjoint=find_water_load_backwards)
def find_water_load(features: Features, access: Access) -> Any:
    """Find the load of a liquid on a particle: depth times area vector [m^3], and wetted area [m^2]."""
    load_of_particle = access.loops(features).water_load

    @wp.func
    def find_water_load(t: Any, points: Any, params: Any):
        return load_of_particle(t, points, params)

    return find_water_load


def _pulling(features: Features, access: Access, name: str, results: str) -> Any:
    """Return the function of a phase that names the values of others, and of a liquid, that its forces depend on."""
    alone, by_velocities = access.alone(features), features.reads_neighbor_velocities
    views = [] if alone else ["points", "velocities"] if by_velocities else ["points"]
    load = ["water_load"] if features.in_water else []
    reads = ["t", *views, "params", "springs", "point", "velocity", *load, "time"]
    of_others = ", ".join([views[0], views[-1]] if views else ["point", "velocity"])  # which looks nowhere
    source = "\n".join(
        [
            f"def {name}({', '.join(f'{each}: Any' for each in reads)}):",
            "    force, area_vector, vertex_normal = net_force(",
            f"        t, {of_others}, params, springs, point, velocity, {load[0] if load else 'wp.vec4()'}, time",
            "    )",
            f"    return {results}\n",
        ]
    )
    return function_from(name, source, {"net_force": net_force_function(features, access.loops(features))})


@phase("particle", {"force": wp.vec3, "area_vector": wp.vec3}, adjoint=pull_backwards)
def pull(features: Features, access: Access) -> Any:
    """Sum the forces on a particle [N], and where it is needed find its area vector [m^2]."""
    return _pulling(features, access, "pull", "force, area_vector")


@phase("particle", {"force": wp.vec3, "area_vector": wp.vec3, "vertex_normal": wp.vec3})
def pull_and_face(features: Features, access: Access) -> Any:
    """Sum the forces on a particle [N], and on the way find its area vector, and A_p n [m^2]."""
    return _pulling(features, access, "pull_and_face", "force, area_vector, vertex_normal")


@phase("particle", {"force": wp.vec3}, when=lambda features: features.touches, adjoint=add_backwards)
@wp.func
def take(working: Working, params: Any, force: wp.vec3):
    """Add contact forces to a particle."""
    return force + take_contact_forces(working, params.world, params.number)


@wp.func
def is_at_neck(t: Any, params: Any):
    """Return whether any particle of eight is at a neck."""
    return any_positive(t.necks.weights[params.number])


@phase(
    "particle", {"force": wp.vec3}, when=lambda features: features.jets, rare=lambda features, access: is_at_neck,
    adjoint=jet_backwards,
)  # fmt: skip
def jet(features: Features, access: Access) -> Any:
    """Add the thrust at the balloon's neck."""
    thrust_at = jet_loop(features, access.at)

    @wp.func
    def jet(t: Tables, points: Any, params: Any, point: wp.vec3, load: wp.vec2, time: float, force: wp.vec3):
        weight = t.necks.weights[params.number]
        return force + thrust_at(t.necks, points, weight, params.balloon, load, wp.dot(point, t.up), time, params.n)

    return jet


@phase("particle", {"force": wp.vec3}, when=lambda features: features.bursts)
def jet_of_holes(features: Features, access: Access) -> Any:
    """Add the thrust of holes where the balloon is torn."""
    thrust_at = hole_jet_loop(features, access.at)

    @wp.func
    def jet_of_holes(
        t: Tables, state: WorldState, points: Any, params: Any, point: wp.vec3, load: wp.vec2, force: wp.vec3
    ):
        if state.bursts[params.world, params.balloon][1] > 0.0:
            return force + thrust_at(t, points, params, load, point)
        return force

    return jet_of_holes


@phase("hinge", when=lambda features: features.has("hinge"))
def add_hinge_forces(features: Features, access: Access) -> Any:
    """Add a hinge's forces to its ends and to the corners of its wings [N]."""
    add_hinge = hinge_function(features, access.at, access.add)

    @wp.func
    def add_hinge_forces(t: Tables, points: Any, forces: Any, world: wp.int32, hinge: wp.int32):
        add_hinge(t, world, hinge, points, forces)

    return add_hinge_forces


@phase("face", when=lambda features: features.has("face"))
def add_face_pushes(features: Features, access: Access) -> Any:
    """Add the force on a face to its corners, in equal shares [N]."""
    push_at_corner, add = face_push(features, access.at, access.velocity_at), access.add

    @wp.func
    def add_face_pushes(
        t: Tables, points: Any, velocities: Any, forces: Any, world: wp.int32, face: wp.int32, time: float
    ):
        share = push_at_corner(t, points, velocities, world, face, time)
        for corner in range(t.faces.offsets[face], t.faces.offsets[face + 1]):
            add(forces, t.faces.particles[corner], share)

    return add_face_pushes


@phase("quad", when=lambda features: features.softens)
def wear_quads(features: Features, access: Access) -> Any:
    """Find the factor on the tension of rubber, and keep its peak stretch, as `wear` does."""
    wear_of_quad = quad_wear(features, access.at, access.world)

    @wp.func
    def wear_quads(t: Any, points: Any, params: Any, peaks: Any):
        wear_of_quad(t, points, params, peaks)

    return wear_quads


@phase("quad", when=lambda features: bool(features.membranes), adjoint=quads_backwards)
def add_membrane_forces(features: Features, access: Access) -> Any:
    """Add the forces of a quad or triangle of a membrane, or of eight of them, to its corners [N]."""
    pull_of_quad, add_to_corners = quad_pull(features, access.at, access.world), access.add_to_corners

    @wp.func
    def add_viscous_membrane_forces(t: Any, points: Any, velocities: Any, forces: Any, params: Any):
        on_a, on_b, on_c, on_d = pull_of_quad(t, points, velocities, params)
        corners = 4 * params.number
        add_to_corners(
            forces, entry_at(t.quads, corners), entry_at(t.quads, corners + 1), entry_at(t.quads, corners + 2),
            entry_at(t.quads, corners + 3), on_a, on_b, on_c, on_d,
        )  # fmt: skip

    @wp.func
    def add_membrane_forces(t: Any, points: Any, forces: Any, params: Any):
        add_viscous_membrane_forces(t, points, points, forces, params)

    return add_viscous_membrane_forces if features.viscous else add_membrane_forces
