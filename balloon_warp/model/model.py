"""The model: topology shared by all worlds, and parameters that may differ between them.

Fixed during a simulation, but for parameters that a scene's timeline writes between frames."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import LAWS, Columns, Law
from balloon_warp.model.obstacles import BodyShape, ObstacleShape
from balloon_warp.model.parameters import VELOCITY, DueChange, views_of
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.stability import StrainBound
from balloon_warp.model.starts import Carriers, Driven
from balloon_warp.model.touch import Ridges
from balloon_warp.scene import Scene


@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """Device arrays of a batch of worlds. The balloons' particles, springs and faces each stand in one array, in order.

    A parameter that may differ between worlds has the leading dimension `world_count`, or 1 for all alike
    (written W below); kernels read it as `parameter[world % parameter.shape[0], ...]`.
    """

    scene: Scene
    shapes: list[BalloonShape]
    """Balloons' meshes at the start, in the scene's order"""
    particle_offsets: list[int]
    """Begin of each balloon's particles, and the end of the last; length balloon_count + 1"""
    device: wp.Device
    world_count: int
    substeps: int
    due_changes: list[DueChange]
    """Changes during the simulation, in order"""
    laws: tuple[Law, ...]
    """Built-in laws and the user's own"""
    warnings: list[str]
    """Warnings on the start, see `ModelPlan.warnings`"""
    strain_bound: StrainBound | None
    """Films whose moduli are lower than their materials', if there are any"""
    frame_seconds: float
    up: wp.vec3

    # particles
    initial_points: wp.array
    """Positions of particles by the scene [m], shape (particle_count,), vec3d"""
    balloon_origins: wp.array
    """Origins of the balloons' meshes [m], about which a world turns them, shape (balloon_count,), vec3d"""
    particle_balloon: wp.array
    """Balloon of each particle, shape (particle_count,), int32"""
    particle_mass_share: wp.array
    """Share of each particle in the balloon's mass, 0 where fixed, shape (particle_count,), float32"""
    particle_face_offsets: wp.array
    """Begin of each particle's faces in `particle_faces`, shape (particle_count + 1,), int32"""
    particle_faces: wp.array
    """Faces around each particle, shape (corner_count,), int32"""

    # faces
    face_offsets: wp.array
    """Begin of each face's corners in `face_particles`, shape (face_count + 1,), int32"""
    face_particles: wp.array
    """Corners of the faces, shape (corner_count,), int32"""
    face_balloon: wp.array
    """Balloon of each face, shape (face_count,), int32"""

    # springs
    spring_particles: wp.array
    """Ends of springs, shape (spring_count,), vec2i"""
    spring_kind: wp.array
    """Kinds of springs: structural 0, shear 1, flexion 2, shape (spring_count,), int32"""
    spring_rest_length: wp.array
    """Rest lengths of springs [m], shape (spring_count,), float32"""
    spring_stiffness_scale: wp.array
    """Spring constants over those of their kinds, shape (spring_count,), float32"""

    # membranes
    membrane_corners: wp.array
    """Corners of the triangles of rubber or film, shape (triangle_count,), vec3i"""
    membrane_rests: wp.array
    """Rest metric of each triangle, see `kernels.tables.MembraneTable`, shape (triangle_count,), vec4"""

    # balloons
    inflation_kind: wp.array
    """Kinds of inflation: normal force 0, pressure 1, gas 2, shape (balloon_count,), int32"""
    keyframe_times: wp.array
    """Times of keyframes [s], shape (balloon_count, keyframe_count); a shorter list repeats its last, float32"""

    # strings, tubes and outer forces
    string_particle: wp.array
    """Particle that each string holds, shape (string_count,), int32"""
    carriers: Carriers
    """Carriers of the anchors of strings"""
    string_carriers: wp.array
    """Obstacle that carries each string's anchor, or -1, and free body, likewise, shape (string_count,), vec2i"""
    string_centers: wp.array
    """Center of mass of that body from its own origin [m], shape (string_count,), vec3"""
    anchor_motion: wp.array
    """Motion of anchors as `obstacle_motion`, shape (frames, string_count), transform; one frame where none moves"""
    tube_balloons: wp.array
    """Two balloons of each tube, shape (tube_count,), vec2i"""
    driven: Driven
    """Particles that outer forces drive"""

    # necks
    neck_weights: wp.array
    """Share of each particle in the thrust at a neck, shape (particle_count,), or (0,) where there is none; float32"""
    neck_offsets: wp.array
    """Begin of the edges around each balloon's neck, shape (balloon_count + 1,), int32"""
    neck_edges: wp.array
    """Edges around the necks, in order, shape (n,), vec2i"""

    # obstacles
    obstacles: list[ObstacleShape]
    """Shapes of obstacles, in the scene's order"""
    obstacle_meshes: list[wp.Mesh | None]
    """Meshes of the obstacles that have one"""
    obstacle_motion: wp.array
    """Shifts of obstacles from their positions, and their rotations, at the start of each frame until all rest, shape
    (frames, obstacle_count), transform"""

    # bodies
    bodies: list[BodyShape]
    """Shapes of free bodies, in the scene's order"""
    body_meshes: list[wp.Mesh | None]
    """Meshes of the bodies that have one"""

    # ridges
    ridges: list[Ridges]
    """Ridges of obstacles, and then of bodies; empty where balloon faces do not touch them"""
    ridge_trees: list[wp.Bvh | None]
    """Bounding volume trees of the ridges of each solid that has any"""

    # parameters
    columns: Columns
    """Columns of the parameters of laws and phases in the next three arrays"""
    balloon_numbers: wp.array
    """Parameters of balloons, shape (W, balloon_count, columns.balloon_width), float32"""
    world_numbers: wp.array
    """Parameters of worlds, shape (W, columns.world_width), float32"""
    sphere_numbers: wp.array
    """Parameters of spheres, shape (W, sphere_count, their width), float32"""
    parameters: dict[str, wp.array]
    """Parameters by name, in the units of their rows. Parameters with columns are views into the three above. The
    others are float32, but for places and velocities, which are vec3:

    - of balloons, shape (W, balloon_count): `initial_turns`, how it starts turned from `initial_points`, a matrix less
      1, mat33d; `initial_shifts`, how far it starts from there [m], vec3d; `initial_centers`, of mass then [m], vec3d;
      `initial_velocities` [m/s] and `initial_spins`, about that center [rad/s]; `initial_gas_amounts` [mol] and
      `initial_free_volumes` [m^3], float64, see `State`; `initial_pressures`, given, or of a gas, above the air's [Pa];
      `initial_loads`, the pressure at height 0 [Pa], and its rise with height [Pa/m], vec2; and `keyframe_values`:
      k_normal, pressure [Pa] or pumped gas [mol/s], by the kind of inflation, shape (W, balloon_count, keyframe_count)
    - of spheres, strings, obstacles, bodies and tubes: see `model.rows`, shape (W, count of them)
    """
    reach: Mapping[str, Sequence[NDArray[np.float32]]] = field(default_factory=dict)
    """Rows of parameters at the bounds of values that are written on the device between frames, by name"""
    contact_room: dict[str, int] = field(default_factory=dict)
    """Lengths to which lists of contacts have grown, by name, in any simulation of this scene"""
    ages: wp.array | None = None
    """Frames since each world began, if each has a time of its own, shape (world_count,), int32"""

    def __repr__(self) -> str:
        balloons = ", ".join(f"{shape.name} of {shape.mesh.vertex_count} particles" for shape in self.shapes)
        worlds = "1 world" if self.world_count == 1 else f"{self.world_count} worlds"
        return f"Model({balloons}; {worlds}, {self.substeps} substeps a frame, {self.device})"

    def require_world(self, world: int) -> None:
        """Make sure that there is a world of that number.

        Raises:
            InputError: there is none.
        """
        if not isinstance(world, int | np.integer) or not 0 <= world < self.world_count:
            raise InputError(f"world: no world {world}; expected 0 to {self.world_count - 1}")

    def with_own_parameters(self) -> Self:
        """Return the model with a copy of its parameters, which may be written though others use this model."""
        return self._with_parameters(wp.clone)

    def with_rows_of_worlds(self) -> Self:
        """Return the model with a row of parameters for each world."""

        def for_each(array: wp.array) -> wp.array:
            if array.size == 0 or array.shape[0] == self.world_count:
                return wp.clone(array)
            rows = np.repeat(array.numpy(), self.world_count, axis=0)
            return wp.array(rows, dtype=array.dtype, device=array.device)

        return self._with_parameters(for_each)

    def of_world(self, world: int, copied: bool = True) -> Self:
        """Return a batch of a single world, with the parameters that one has.

        Args:
            copied: or else they are views, and change as this model's do.
        """

        def row(array: Any) -> wp.array:
            if array.size == 0 or array.shape[0] == 1:
                return array
            return wp.clone(array[world : world + 1]) if copied else array[world : world + 1]

        ages = None if self.ages is None else row(self.ages)
        return replace(self._with_parameters(row), world_count=1, ages=ages)

    def _with_parameters(self, made_of: Callable[[wp.array], wp.array]) -> Self:
        """Return the model with other arrays, each made of an existing one."""
        packed = {name: made_of(getattr(self, name)) for name in ("balloon_numbers", "world_numbers", "sphere_numbers")}
        views = views_of(self.columns, **packed)
        others = {name: made_of(array) for name, array in self.parameters.items() if name not in views}
        return replace(self, **packed, parameters={**views, **others})

    @property
    def own_laws(self) -> tuple[Law, ...]:
        """Laws of the user."""
        return self.laws[len(LAWS) :]

    @property
    def step_seconds(self) -> float:
        return self.frame_seconds / self.substeps

    @property
    def is_steered(self) -> bool:
        """Return whether velocities of obstacles are written on the device."""
        return VELOCITY in self.reach

    @property
    def faces_meet(self) -> bool:
        """Return whether faces of balloons touch ridges of obstacles and bodies."""
        return bool(self.ridges)

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
    def triangle_faces(self) -> NDArray[np.int64]:
        """Face of each triangle of membranes, in the order of `membrane_corners`."""
        firsts = np.cumsum([0, *(shape.mesh.face_count for shape in self.shapes)])
        faces = (shape.membrane.faces + first for shape, first in zip(self.shapes, firsts, strict=False))
        return np.concatenate(list(faces))

    @property
    def triangle_count(self) -> int:
        """Number of triangles of membranes."""
        return self.membrane_corners.shape[0]

    @property
    def softens(self) -> bool:
        """Return whether a balloon is of rubber that may soften."""
        return any(balloon.material.softening is not None for balloon in self.scene.balloon)

    @property
    def bursts(self) -> bool:
        """Return whether a balloon may burst."""
        return any(balloon.material.strength is not None for balloon in self.scene.balloon)

    @property
    def balloon_count(self) -> int:
        return len(self.shapes)

    @property
    def sphere_count(self) -> int:
        return self.sphere_numbers.shape[1]

    @property
    def body_count(self) -> int:
        return len(self.bodies)

    @property
    def string_count(self) -> int:
        return self.string_particle.shape[0]

    @property
    def tube_count(self) -> int:
        return self.tube_balloons.shape[0]


def fitting(model: Model, name: str, values: ArrayLike) -> NDArray[np.float32]:
    """Return the values as a parameter of the model has them.

    Raises:
        InputError: there is no such parameter, or its values have another shape or are not finite.
    """
    if name not in model.parameters:
        raise InputError(f"{name}: no such parameter; known are {', '.join(sorted(model.parameters))}")
    shape = model.parameters[name].numpy().shape
    try:
        rows = np.broadcast_to(np.asarray(values, dtype=np.float32), shape)
    except (TypeError, ValueError):
        raise InputError(f"{name}: must be numbers of shape {shape} (got {str(values)[:60]})") from None
    if not np.isfinite(rows).all():
        raise InputError(f"{name}: must be finite (got {str(values)[:60]})")
    return rows
