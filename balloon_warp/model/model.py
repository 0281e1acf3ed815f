"""The model: topology shared by all worlds, and parameters that may differ between them.

Fixed during a simulation, but for what a scene's timeline writes into the parameters between frames."""

from dataclasses import dataclass

import warp as wp

from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.timeline import Turn
from balloon_warp.scene import Scene


@dataclass(frozen=True)
class Model:
    """Device arrays of a batch of worlds. The balloons' particles, springs and faces each stand in one array, in order.

    A parameter that may differ between worlds has the leading dimension `world_count`, or 1 for all alike
    (written W below); kernels read it as `parameter[world % parameter.shape[0], ...]`.
    """

    scene: Scene
    shapes: list[BalloonShape]
    """the balloons' meshes at the start, in the scene's order"""
    particle_offsets: list[int]
    """where each balloon's particles begin, and after the last, where they end; length balloon_count + 1"""
    device: wp.Device
    world_count: int
    substeps: int
    turns: list[Turn]
    """what changes during the simulation, in order"""
    frame_seconds: float
    up: wp.vec3

    # particles
    initial_points: wp.array
    """where the scene puts them [m], shape (particle_count,), vec3d"""
    initial_shifts: wp.array
    """of each balloon from there [m], shape (W, balloon_count), vec3d"""
    particle_balloon: wp.array
    """the balloon of each particle, shape (particle_count,), int32"""
    particle_mass_share: wp.array
    """part of the balloon's mass, 0 where fixed, shape (particle_count,), float32"""
    particle_face_offsets: wp.array
    """where each particle's faces begin in `particle_faces`, shape (particle_count + 1,), int32"""
    particle_faces: wp.array
    """faces around each particle, shape (corner_count,), int32"""

    # faces
    face_offsets: wp.array
    """where each face's corners begin in `face_particles`, shape (face_count + 1,), int32"""
    face_particles: wp.array
    """corners of the faces, shape (corner_count,), int32"""
    face_balloon: wp.array
    """the balloon of each face, shape (face_count,), int32"""

    # springs
    spring_particles: wp.array
    """ends, shape (spring_count,), vec2i"""
    spring_kind: wp.array
    """structural 0, shear 1, flexion 2, shape (spring_count,), int32"""
    spring_rest_length: wp.array
    """[m], shape (spring_count,), float32"""
    spring_stiffness_scale: wp.array
    """a spring's constant over that of its kind, shape (spring_count,), float32"""

    correction_limit: wp.array
    """strain beyond which a spring is shortened after a step, shape (W,), float32"""

    # balloons
    stiffness: wp.array
    """spring constants by kind [N/m], shape (W, balloon_count, 3), float32"""
    torsion: wp.array
    """[N m/rad], shape (W, balloon_count), float32"""
    viscosity: wp.array
    """damping constants of springs over their spring constants [s], shape (W, balloon_count), float32"""
    yield_stretch: wp.array
    """length of a spring over its rest length from which on it does not pull, shape (W, balloon_count), float32"""
    mass: wp.array
    """[kg], shape (W, balloon_count), float32"""
    helium: wp.array
    """lift by mass [N/kg], shape (W, balloon_count), float32"""
    damping: wp.array
    """[N s/m], shape (W, balloon_count), float32"""
    keyframe_times: wp.array
    """[s], shape (balloon_count, keyframe_count); a shorter list repeats its last, float32"""
    keyframe_values: wp.array
    """k_normal, pressure [Pa] or pumped gas [mol/s], by the kind of inflation, float32,
    shape (W, balloon_count, keyframe_count)"""
    inflation_kind: wp.array
    """normal force 0, pressure 1, gas 2, shape (balloon_count,), int32"""
    initial_gas_amounts: wp.array
    """[mol], shape (W, balloon_count), float64"""
    initial_loads: wp.array
    """pressure at height 0 [Pa], and its rise with height [Pa/m], shape (W, balloon_count), vec2"""
    initial_pressures: wp.array
    """given, or of a gas, above the air's [Pa], shape (W, balloon_count), float32"""
    gamma: wp.array
    """p V^gamma of a gas stays as it is, shape (W, balloon_count), float32"""
    molar_mass: wp.array
    """of a gas [kg/mol], shape (W, balloon_count), float32"""
    drag_coefficient: wp.array
    """C_d in air, shape (W, balloon_count), float32"""

    # spheres
    initial_sphere_positions: wp.array
    """[m], shape (W, sphere_count), vec3"""
    initial_sphere_velocities: wp.array
    """[m/s], shape (W, sphere_count), vec3"""
    sphere_mass: wp.array
    """[kg], shape (W, sphere_count), float32"""
    sphere_radius: wp.array
    """[m], shape (W, sphere_count), float32"""
    sphere_penalty: wp.array
    """shape (W, sphere_count), float32"""

    # strings
    string_particle: wp.array
    """the particle each holds, shape (string_count,), int32"""
    string_anchor: wp.array
    """[m], shape (W, string_count), vec3"""
    string_length: wp.array
    """[m], shape (W, string_count), float32"""
    string_stiffness: wp.array
    """[N/m], shape (W, string_count), float32"""

    # tubes
    tube_balloons: wp.array
    """its two balloons, shape (tube_count,), vec2i"""
    tube_conductance: wp.array
    """[mol/(s Pa)], shape (W, tube_count), float32"""

    # surroundings
    in_air: bool
    """whether there is pressure, gas or drag; a substep then sums the other forces before it finds the pressures"""
    air_pressure: wp.array
    """[Pa], shape (W,), float32"""
    air_temperature: wp.array
    """[K], shape (W,), float32"""
    air_density: wp.array
    """[kg/m^3], below 0 for that of dry air as an ideal gas, shape (W,), float32"""
    wind: wp.array
    """[m/s], shape (W,), vec3"""
    gravity: wp.array
    """[m/s^2], shape (W,), float32"""
    ground_height: wp.array
    """[m], minus infinity where there is no ground, shape (W,), float32"""
    ground_friction: wp.array
    """Coulomb's coefficient for balloons, shape (W,), float32"""
    ground_restitution: wp.array
    """rebound speed over impact speed of spheres, shape (W,), float32"""
    water_level: wp.array
    """[m], minus infinity where there is no liquid, shape (W,), float32"""
    water_density: wp.array
    """[kg/m^3], shape (W,), float32"""
    water_drag: wp.array
    """coefficient of the quadratic drag, shape (W,), float32"""

    @property
    def step_seconds(self) -> float:
        return self.frame_seconds / self.substeps

    @property
    def has_water(self) -> bool:
        return self.scene.water is not None

    @property
    def particle_count(self) -> int:
        return self.particle_balloon.shape[0]

    @property
    def face_count(self) -> int:
        return self.face_balloon.shape[0]

    @property
    def spring_count(self) -> int:
        return self.spring_kind.shape[0]

    @property
    def balloon_count(self) -> int:
        return len(self.shapes)

    @property
    def sphere_count(self) -> int:
        return self.sphere_mass.shape[1]

    @property
    def string_count(self) -> int:
        return self.string_particle.shape[0]
