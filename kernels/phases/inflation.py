"""Inflation: normal forces, pressures, and gas that flows.

Gas is pumped in or let out as a substep begins, and flows through tubes, necks and leaks once its pressure is known.

A skin may be too soft to bear how much harder a liquid presses below than above. In a liquid at rest no such skin has a
shape: it would dent until it meets itself, and the liquid with it would turn inside out what crosses. So what the skin
does not bear lifts the balloon as a whole.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.gas import load_backwards, note_backwards, pump_backwards
from balloon_warp.kernels.adjoints.pull import directions_backwards, inflate_backwards, lift_backwards
from balloon_warp.kernels.adjoints.solids import predict_deflection_backwards
from balloon_warp.kernels.algebra import dot_product, length_of, reach_along, scaled, times
from balloon_warp.kernels.compose import call_of, function_from, ramp_at
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import Five, pair
from balloon_warp.kernels.laws.air import AIR, air_of_height, molar_volume
from balloon_warp.kernels.laws.gas import (
    NO_INSIDE,
    Swelling,
    free_along,
    free_volume_of,
    memory_of_rate,
    rate_beside_obstacles,
    swelling_of_particle,
)
from balloon_warp.kernels.laws.law import TINY
from balloon_warp.kernels.laws.membrane import OPEN
from balloon_warp.kernels.laws.outer import (
    EVENED,
    GAS,
    GRAVITY,
    NORMAL_FORCE,
    PRESSURE,
    evened,
    inflation_direction_of,
    normal_push,
)
from balloon_warp.kernels.loops.areas import (
    area_vector_between,
    direction_loop,
    direction_loop_of_eight,
    face_measures,
    volume_origin,
)
from balloon_warp.kernels.loops.contact import around_function, deflection_function, near_solids_ahead
from balloon_warp.kernels.loops.gas import (
    flows_function,
    gas_mass_function,
    load_function,
    own_gas_test,
    pump_function,
)
from balloon_warp.kernels.memory import quad_at
from balloon_warp.kernels.phase import Access, by_grad, by_grad_but, nothing, phase
from balloon_warp.kernels.phases.forces import (
    SQUARE_MICROMETERS,
    area_vector_of_face,
    center_of_face,
    face_of,
    unpacked,
)
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world
from balloon_warp.kernels.working import Working


@phase(
    "balloon", {"gas": wp.vec2}, when=lambda features: features.gas, light=True,
    once=lambda features: not features.gas_changes, adjoint=nothing,
)  # fmt: skip
@wp.func
def read_gas(state: WorldState, world: wp.int32, balloon: wp.int32):
    """Read the gas in a balloon: its amount [mol], and its free volume [m^3]."""
    return wp.vec2(float(state.gas_amounts[world, balloon]), float(state.free_volumes[world, balloon]))


@phase("balloon", {"gas_load": wp.vec4}, when=lambda features: features.gas, adjoint=load_backwards)
def find_load(features: Features, access: Access) -> Any:
    """Find the pressure of the gas."""
    load_of_balloon, holds_gas = load_function(features), own_gas_test(features)

    @wp.func
    def load_of_gas(t: Tables, balloon: wp.int32, swelling: Swelling, gas: wp.vec2, numbers: Any):
        return load_of_balloon(GAS, 0.0, swelling, gas, t.step_seconds, t.faces.enclosed[balloon], numbers)

    @wp.func
    def load_of_any(
        t: Tables,
        state: WorldState,
        world: wp.int32,
        balloon: wp.int32,
        time_in_frame: float,
        swelling: Swelling,
        gas: wp.vec2,
        numbers: Any,
    ):
        kind = t.inflation_kind[balloon]
        given = ramp_at(state, world, balloon, time_in_frame)
        enclosed = t.faces.enclosed[balloon]
        if wp.static(features.bursts):
            if holds_gas(t, state, world, balloon):
                kind = GAS
            elif state.bursts[world, balloon][0] >= 0.0:
                kind = PRESSURE
                given = 0.0  # it is open
                enclosed = wp.vec2(NO_INSIDE, enclosed[1])
        return load_of_balloon(kind, given, swelling, gas, t.step_seconds, enclosed, numbers)

    return load_of_gas if features.balloons == 1 and not (features.bursts or features.crushes) else load_of_any


@phase("balloon", when=lambda features: features.gas, adjoint=note_backwards)
def note(features: Features, access: Access) -> Any:
    """Note the pressure in the state."""

    @wp.func
    def note(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, gas_load: wp.vec4):
        if t.inflation_kind[balloon] != NORMAL_FORCE:
            state.pressures[world, balloon] = gas_load[0]
            state.inflation_loads[world, balloon] = wp.vec2(gas_load[1], gas_load[2])
            if wp.static(features.gas_flows):
                state.pressure_slopes[world, balloon] = gas_load[3]

    return note


@wp.func
def pressure_at(load: Any, rise: Any, point: Any, up: wp.vec3):
    """Return the gauge pressure at a place, from that at height 0 [Pa] and how it rises with height [Pa/m]."""
    return load + times(rise, reach_along(point, up))


@phase(
    "particle", {"load": wp.vec2}, when=lambda features: features.pressures and not features.gas, light=True,
    adjoint=by_grad,
)  # fmt: skip
@wp.func
def given_load(keyed: Any):
    """Take a given pressure, the same at all heights.

    Return the gauge pressure at height 0 [Pa], and its gradient with height [Pa/m].
    """
    return pair(keyed, 0.0)


@wp.func
def push_along_direction(keyed: Any, inflation_direction: Any):
    """Return the paper's force along a particle's direction [N]."""
    return scaled(inflation_direction, normal_push(keyed))


@wp.func
def push_by_pressure(t: Any, load: Any, point: Any, area_vector: Any):
    """Return the force of a pressure on a particle [N]."""
    return scaled(area_vector, pressure_at(load[0], load[1], point, t.up))


@wp.func
def push_either_way(t: Any, params: Any, keyed: Any, load: Any, point: Any, inflation_direction: Any, area_vector: Any):
    """Return the force on a particle as its balloon is inflated [N]."""
    push = pressure_at(load[0], load[1], point, t.up)
    along = area_vector
    if params.kind == NORMAL_FORCE:
        push = normal_push(keyed)
        along = inflation_direction
    return scaled(along, push)


@phase("particle", {"inflation": wp.vec3}, adjoint=inflate_backwards)
def inflate(features: Features, access: Access) -> Any:
    """Find the force of the inflation [N]."""
    if not features.pressures:
        return push_along_direction
    return push_either_way if features.inflation_directions else push_by_pressure


@phase("particle", {"net_force": wp.vec3})
@wp.func
def add_up(force: Any, inflation: Any):
    """Sum all forces [N], for output."""
    return force + inflation


def _by_normal_forces(features: Features) -> bool:
    return features.inflation_directions


def _cached(features: Features) -> bool:
    """Return whether a frame keeps the directions from its beginning, as the paper does."""
    return not features.fresh_normals


@phase(
    "face",
    {"face_center": wp.vec3, "face_area": wp.vec3},
    when=_by_normal_forces,
    once=_cached,
    adjoint=directions_backwards,
)
def measure(features: Features, access: Access) -> Any:
    """Measure the center of a face [m], and its area times its unit normal [m^2]."""
    center_of_face, area_vector_of_face = face_measures(access.at)

    @wp.func
    def measure(t: Any, points: Any, face: Any):
        center = center_of_face(t.faces, points, face)
        return center, area_vector_of_face(t.faces, points, face, center)

    return measure


@phase("face", {"balloon_area": float}, when=_by_normal_forces, once=_cached, sums=True, adjoint=directions_backwards)
@wp.func
def extend(face_area: Any):
    """Sum the area of a balloon [m^2]."""
    return length_of(face_area)


@phase("particle", {"inflation_direction": wp.vec3}, when=_by_normal_forces, once=_cached, adjoint=directions_backwards)
def find_direction(features: Features, access: Access) -> Any:
    """Find where a normal force pushes a particle: (A_p / A_total) n."""
    direction_of_particle = direction_loop_of_eight(access.at) if access.world else direction_loop(access.at)

    @wp.func
    def find_direction(t: Any, face_centers: Any, face_areas: Any, particle: Any, point: Any, balloon_area: Any):
        return direction_of_particle(t.faces, face_centers, face_areas, particle, point, balloon_area)

    return find_direction


@wp.func
def spread_quads(t: Any, points: Any, face: wp.int32):
    """Return the area of a quad [m^2]."""
    return wp.length(area_vector_between(points, quad_at(t.faces.particles, face)))


@phase("face", {"balloon_area": float}, when=_by_normal_forces, once=_cached, sums=True)
def spread(features: Features, access: Access) -> Any:
    """Sum the area of a balloon [m^2], from where its corners are."""
    center_of_face, area_vector_of_face = face_measures(access.at)

    @wp.func
    def spread(t: Any, points: Any, face: wp.int32):
        return wp.length(area_vector_of_face(t.faces, points, face, center_of_face(t.faces, points, face)))

    return spread_quads if features.quads else spread


@phase("particle", {"inflation_direction": wp.vec3}, when=_by_normal_forces, once=_cached)
@wp.func
def turn(vertex_normal: wp.vec3, balloon_area: float):
    """Find where a normal force pushes a particle, from A_p n: (A_p / A_total) n."""
    return inflation_direction_of(vertex_normal, balloon_area)


def _beside(features: Features) -> bool:
    return features.gas and features.obstacles


@phase("particle", {"predicted_velocity": wp.vec3}, when=_beside, light=True, adjoint=by_grad)
@wp.func
def predict_velocity(t: Any, load: Any, gain: Any, point: Any, free_velocity: Any, area_vector: Any):
    """Predict a particle's velocity under the load of the previous substep [m/s]."""
    push = load[0] + times(load[1], reach_along(point, t.up))
    return free_velocity + scaled(area_vector, times(gain, push))


@phase(
    "particle", {"deflection": wp.vec3, "away": wp.vec3}, when=_beside, light=True, rare=near_solids_ahead,
    adjoint=predict_deflection_backwards,
)  # fmt: skip
def predict_deflection(features: Features, access: Access) -> Any:
    """Predict the velocity change by obstacles [m/s], and the direction from the last one; zero if there is none."""
    deflection_beside, around_particle = deflection_function(features, access.sphere_at), around_function(features)

    @wp.func
    def predict_deflection(
        t: Tables, spheres: Any, params: Any, end: float, gain: float, point: wp.vec3, predicted_velocity: wp.vec3
    ):
        deflection = wp.vec3()
        away = wp.vec3()
        if gain > 0.0:
            turned, normal = deflection_beside(t, spheres, around_particle(params, end), point, predicted_velocity)
            deflection = turned
            away = normal
        return deflection, away

    @wp.func
    def predict_deflection_by_solids(
        t: Tables, params: Any, end: float, gain: float, point: wp.vec3, predicted_velocity: wp.vec3
    ):
        return predict_deflection(t, t, params, end, gain, point, predicted_velocity)

    return predict_deflection if features.spheres else predict_deflection_by_solids


@phase("particle", {"swelling": Swelling}, when=lambda features: features.gas, sums=True, adjoint=by_grad_but("origin"))
def find_volume_rate(features: Features, access: Access) -> Any:
    """Sum the swelling of a balloon without its gas."""
    place = features.columns.places["breathing_damping"]

    @wp.func
    def without_memory(predicted_velocity: Any, params: Any, velocity: Any):
        """Take from a course the part of the velocity before the step that counts, where one breathes on."""
        if wp.static(features.breathes_on):
            return predicted_velocity - scaled(velocity, memory_of_rate(params.n[place]))
        else:
            return predicted_velocity

    @wp.func
    def of_kind(params: Any, swelling: Any):
        """Leave the swelling zero, where a normal force inflates."""
        if wp.static(features.inflation_directions):
            return wp.where(params.kind == NORMAL_FORCE, 0.0 * swelling, swelling)
        else:
            return swelling

    @wp.func
    def find_volume_rate(
        t: Any, params: Any, gain: Any, origin: Any, point: Any, velocity: Any, free_velocity: Any, area_vector: Any
    ):
        rate = dot_product(area_vector, without_memory(free_velocity, params, velocity))
        height = reach_along(point, t.up)
        return of_kind(
            params, swelling_of_particle(point - origin, area_vector, area_vector, rate, gain, params.share, height)
        )

    @wp.func
    def find_volume_rate_beside(
        t: Any, params: Any, gain: Any, load: Any, origin: Any, point: Any, velocity: Any, free_velocity: Any,
        area_vector: Any, deflection: Any, away: Any,
    ):  # fmt: skip
        height = reach_along(point, t.up)
        free = free_along(area_vector, away)
        push = load[0] + times(load[1], height)
        moved = without_memory(free_velocity + deflection, params, velocity)
        rate = rate_beside_obstacles(area_vector, free, moved, gain, push)
        return of_kind(
            params, swelling_of_particle(point - origin, area_vector, free, rate, gain, params.share, height)
        )

    return find_volume_rate_beside if features.obstacles else find_volume_rate


def _stays(features: Features) -> bool:
    """Return whether the amount of gas is constant over a frame."""
    return not features.gas_changes


@phase("world", when=lambda features: features.gas, once=_stays, adjoint=pump_backwards)
def pump(features: Features, access: Access) -> Any:
    """Pump gas in, or let it out."""
    return pump_function(features)


@phase("balloon", when=lambda features: features.gas, once=_stays, adjoint=pump_backwards)
def find_gas_mass(features: Features, access: Access) -> Any:
    """Weigh the gas in a balloon, and the air that moves along."""
    gas_mass = gas_mass_function(features)

    @wp.func
    def find_gas_mass(t: Tables, state: WorldState, working: Working, world: wp.int32, balloon: wp.int32):
        working.gas_masses[world, balloon] = gas_mass(t, state, world, balloon)

    return find_gas_mass


@wp.func
def own_mass(params: Any):
    """Return the mass of a particle [kg]."""
    return params.mass


@wp.func
def mass_with_gas(params: Any, gas_mass: Any):
    """Return the mass of a particle and of its share of the gas [kg]."""
    return params.mass + times(params.share, gas_mass)


@phase("particle", {"inertia": float}, light=True, once=lambda features: not features.gas_changes, adjoint=by_grad)
def find_effective_mass(features: Features, access: Access) -> Any:
    """Find the effective mass of a particle, with its share of the gas, which moves along [kg]."""
    return mass_with_gas if features.gas else own_mass


@phase("world", when=lambda features: features.gas_flows, adjoint=pump_backwards)
def flow(features: Features, access: Access) -> Any:
    """Exchange gas through tubes, necks and leaks, driven by the current pressures."""
    return flows_function(features)


GasColumns = wp.types.vector(length=6, dtype=wp.int32)
"""Columns of the air's pressure, temperature, density and lapse rate and of gravity in the world's numbers; and of the
gas's gamma in the balloon's"""


@wp.func
def enclosed(t: Tables, points: wp.array[wp.vec3], balloon: wp.int32):
    """Return the volume enclosed by a balloon's faces [m^3]."""
    volume = float(0.0)
    first = t.faces.balloon_offsets[balloon]
    origin = center_of_face(t.faces, points, first)
    for face in range(first, t.faces.balloon_offsets[balloon + 1]):
        center = center_of_face(t.faces, points, face)
        volume += wp.dot(center - origin, area_vector_of_face(t.faces, points, face, center)) / 3.0
    return volume


@wp.func
def seal_air_in(
    t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, columns: GasColumns, volume: float, height: float
):
    """Seal air of a balloon's volume [m^3] into a balloon with a given pressure."""
    of_world = t.world_numbers[row_of_world(world, t.world_numbers.shape[0])]
    gamma = t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon, columns[5]]
    air = air_of_height(
        height, of_world[columns[0]], of_world[columns[1]], of_world[columns[2]], of_world[columns[3]],
        of_world[columns[4]],
    )  # fmt: skip
    pressure = wp.max(air[0] + state.pressures[world, balloon], 0.0)
    state.gas_amounts[world, balloon] = wp.float64(volume / molar_volume(wp.max(pressure, TINY), air[1]))
    state.free_volumes[world, balloon] = wp.float64(
        free_volume_of(volume, pressure, gamma, air[1] / of_world[columns[1]])
    )


@phase("balloon", when=lambda features: features.bursts)
def burst(features: Features, access: Access) -> Any:
    """Burst a balloon, and find the area of its hole, through which gas leaves."""
    places, split = features.columns.places, features.columns.balloon_width
    told = GasColumns(*(places[row.name] - split for row in (*AIR, GRAVITY)), places["gamma"])

    @wp.func
    def open_balloon(
        t: Tables,
        state: WorldState,
        points: wp.array[wp.vec3],
        world: wp.int32,
        balloon: wp.int32,
        time_in_frame: float,
        time: float,
    ):
        tears = t.membranes.wear.tears
        burst = state.bursts[world, balloon]
        weakest = tears.weakest[world, balloon]
        tears.weakest[world, balloon] = wp.int64(0)
        if burst[0] < 0.0 and weakest > wp.int64(0):
            if t.inflation_kind[balloon] != GAS:
                state.pressures[world, balloon] = ramp_at(state, world, balloon, time_in_frame)
                height = wp.dot(points[volume_origin(t, balloon)], t.up)
                volume = enclosed(t, points, balloon)
                seal_air_in(t, state, world, balloon, told, wp.max(volume, 0.0), height)
            burst = wp.vec4(time, 0.0, float(face_of(weakest)), unpacked(weakest))
        elif burst[0] >= 0.0 and burst[1] >= 0.0:  # from the next substep on, by the load that this one finds
            hole = float(wp.float64(tears.areas[world, balloon, 0]) / SQUARE_MICROMETERS)
            whole = float(wp.float64(tears.areas[world, balloon, 1]) / SQUARE_MICROMETERS)
            burst[1] = hole
            if whole > 0.0 and hole > OPEN * (hole + whole):
                burst[1] = -1.0
                state.gas_amounts[world, balloon] = wp.float64(0.0)
                state.free_volumes[world, balloon] = wp.float64(0.0)
        state.bursts[world, balloon] = burst
        tears.areas[world, balloon, 0] = wp.int64(0)
        tears.areas[world, balloon, 1] = wp.int64(0)

    return open_balloon


RESTS = {EVENED.name: 0.0}
"""Values at which skins bear all"""


def _evens(features: Features) -> bool:
    return features.in_water and features.gas


@phase("particle", {"afloat": Five}, when=_evens, sums=True, neutral=RESTS, adjoint=by_grad)
@wp.func
def find_lift(t: Any, params: Any, point: wp.vec3, area_vector: wp.vec3, water_load: wp.vec4):
    """Sum a balloon's displaced volume [m^3], the height of its center of mass [m], and its volume [m^3]."""
    height = wp.dot(point, t.up)
    lift = -(water_load[0] * t.up[0] + water_load[1] * t.up[1] + water_load[2] * t.up[2])
    return Five(lift, params.share * height, height * wp.dot(area_vector, t.up), 0.0, 0.0)


@phase("particle", {"upheld": Five}, when=_evens, neutral=RESTS, adjoint=lift_backwards)
@wp.func
def read_lift(afloat: Any):
    """Read the sums of a balloon, each particle by itself: so bars add up."""
    return afloat


@phase("particle", {"force": wp.vec3}, when=_evens, neutral=RESTS, adjoint=by_grad)
def even_out(features: Features, access: Access) -> Any:
    """Let the part of a liquid's pressure that a skin does not bear act evenly."""

    given = ["water_load", "area_vector", "share", "lift", "height", "volume", "up"]
    source = (
        f"def evened_here({', '.join(f'{name}: Any' for name in (*given, 'n'))}):\n"
        f"    return {call_of(evened, 'evened', given, features.columns)}\n"
    )
    evened_here = function_from("evened_here", source, {"evened": evened})

    @wp.func
    def even_out(
        t: Any, params: Any, force: wp.vec3, area_vector: wp.vec3, water_load: wp.vec4, upheld: Five
    ):  # fmt: skip
        more = evened_here(water_load, area_vector, params.share, upheld[0], upheld[1], upheld[2], t.up, params.n)
        return force + more

    return even_out
