"""The model: topology shared by all worlds, and parameters that may differ between them. Fixed during a simulation."""

from dataclasses import dataclass

import warp as wp

from balloon_warp.model.shape import BalloonShape
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
    frame_seconds: float
    up: wp.vec3

    # particles
    initial_points: wp.array2d[wp.vec3]
    """[m], shape (1, particle_count)"""
    particle_balloon: wp.array[wp.int32]
    """the balloon of each particle, shape (particle_count,)"""
    particle_mass_share: wp.array[float]
    """part of the balloon's mass, 0 where fixed, shape (particle_count,)"""
    particle_face_offsets: wp.array[wp.int32]
    """where each particle's faces begin in `particle_faces`, shape (particle_count + 1,)"""
    particle_faces: wp.array[wp.int32]
    """faces around each particle, shape (corner_count,)"""

    # faces
    face_offsets: wp.array[wp.int32]
    """where each face's corners begin in `face_particles`, shape (face_count + 1,)"""
    face_particles: wp.array[wp.int32]
    """corners of the faces, shape (corner_count,)"""
    face_balloon: wp.array[wp.int32]
    """the balloon of each face, shape (face_count,)"""

    # springs
    spring_particles: wp.array[wp.vec2i]
    """ends, shape (spring_count,)"""
    spring_kind: wp.array[wp.int32]
    """structural 0, shear 1, flexion 2, shape (spring_count,)"""
    spring_rest_length: wp.array[float]
    """[m], shape (spring_count,)"""
    spring_stiffness_scale: wp.array[float]
    """a spring's constant over that of its kind, shape (spring_count,)"""

    # balloons
    stiffness: wp.array3d[float]
    """spring constants by kind [N/m], shape (W, balloon_count, 3)"""
    mass: wp.array2d[float]
    """[kg], shape (W, balloon_count)"""
    helium: wp.array2d[float]
    """lift by mass [N/kg], shape (W, balloon_count)"""
    damping: wp.array2d[float]
    """[N s/m], shape (W, balloon_count)"""
    keyframe_times: wp.array2d[float]
    """[s], shape (balloon_count, keyframe_count); a shorter list repeats its last"""
    keyframe_values: wp.array3d[float]
    """k_normal, shape (W, balloon_count, keyframe_count)"""

    # spheres
    initial_sphere_positions: wp.array2d[wp.vec3]
    """[m], shape (W, sphere_count)"""
    initial_sphere_velocities: wp.array2d[wp.vec3]
    """[m/s], shape (W, sphere_count)"""
    sphere_mass: wp.array2d[float]
    """[kg], shape (W, sphere_count)"""
    sphere_radius: wp.array2d[float]
    """[m], shape (W, sphere_count)"""
    sphere_penalty: wp.array2d[float]
    """shape (W, sphere_count)"""

    # strings
    string_particle: wp.array[wp.int32]
    """the particle each holds, shape (string_count,)"""
    string_anchor: wp.array[wp.vec3]
    """[m], shape (string_count,)"""
    string_length: wp.array2d[float]
    """[m], shape (W, string_count)"""
    string_stiffness: wp.array2d[float]
    """[N/m], shape (W, string_count)"""

    # surroundings
    gravity: wp.array[float]
    """[m/s^2], shape (W,)"""
    ground_height: float
    """[m]; minus infinity where there is no ground"""
    ground_friction: float
    ground_restitution: float

    @property
    def step_seconds(self) -> float:
        return self.frame_seconds / self.substeps

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
