"""The model: topology shared by all worlds, and parameters that may differ between them.

Fixed during a simulation, but for what a scene's timeline writes into the parameters between frames."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import LAWS, Law
from balloon_warp.kernels.laws.columns import Columns
from balloon_warp.model.bodies import BodyShape
from balloon_warp.model.obstacles import ObstacleShape
from balloon_warp.model.packing import views_of
from balloon_warp.model.ridges import Ridges
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.timeline import DueChange
from balloon_warp.scene import Scene


@dataclass(frozen=True, eq=False, repr=False)
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
    due_changes: list[DueChange]
    """what changes during the simulation, in order"""
    laws: tuple[Law, ...]
    """the built-in ones and the user's own"""
    warnings: list[str]
    """what is odd at the start, see `ModelPlan.warnings`"""
    frame_seconds: float
    up: wp.vec3

    # particles
    initial_points: wp.array
    """where the scene puts them [m], shape (particle_count,), vec3d"""
    balloon_origins: wp.array
    """where it puts the origins of the balloons' meshes [m], about which a world turns them, shape (balloon_count,),
    vec3d"""
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

    # membranes
    membrane_corners: wp.array
    """of the triangles of rubber or film, shape (triangle_count,), vec3i"""
    membrane_rests: wp.array
    """what each is at rest, see `kernels.tables.MembraneTable`, shape (triangle_count,), vec4"""

    # balloons
    inflation_kind: wp.array
    """normal force 0, pressure 1, gas 2, shape (balloon_count,), int32"""
    keyframe_times: wp.array
    """[s], shape (balloon_count, keyframe_count); a shorter list repeats its last, float32"""

    # strings and tubes
    string_particle: wp.array
    """the particle each holds, shape (string_count,), int32"""
    tube_balloons: wp.array
    """its two balloons, shape (tube_count,), vec2i"""

    # necks
    neck_weights: wp.array
    """each particle's part of the thrust of its balloon's neck, shape (particle_count,), or (0,) where no balloon has
    one; float32"""
    neck_offsets: wp.array
    """where the edges around each balloon's neck begin, shape (balloon_count + 1,), int32"""
    neck_edges: wp.array
    """in turn, shape (n,), vec2i"""

    # obstacles
    obstacles: list[ObstacleShape]
    """their shapes, in the scene's order"""
    obstacle_meshes: list[wp.Mesh | None]
    """those of the obstacles that have one"""
    obstacle_motion: wp.array
    """shifts from their positions, and how they are turned, at the start of each frame until all rest, shape (frames,
    obstacle_count), transform"""

    # bodies
    bodies: list[BodyShape]
    """their shapes, in the scene's order"""
    body_meshes: list[wp.Mesh | None]
    """those of the bodies that have one"""

    # ridges
    ridges: list[Ridges]
    """of obstacles, and then of bodies; empty where faces of balloons do not meet them"""
    ridge_trees: list[wp.Bvh | None]
    """of boxes around the ridges of each, where it has any"""

    # parameters
    columns: Columns
    """where the laws' parameters stand in the next two"""
    balloon_numbers: wp.array
    """shape (W, balloon_count, columns.balloon_width), float32"""
    world_numbers: wp.array
    """shape (W, columns.world_width), float32"""
    parameters: dict[str, wp.array]
    """all by name, in the units of their rows. The laws' are views into the two above. The others are float32, but for
    places and velocities, which are vec3:

    - of balloons, shape (W, balloon_count): `initial_turns`, how it starts turned from `initial_points`, a matrix less
      1, mat33d; `initial_shifts`, how far it starts from there [m], vec3d; `initial_centers`, of mass then [m], vec3d;
      `initial_velocities` [m/s] and `initial_spins`, about that center [rad/s]; `initial_gas_amounts` [mol] and
      `initial_free_volumes` [m^3], float64, see `State`; `initial_pressures`, given, or of a gas, above the air's [Pa];
      `initial_loads`, the pressure at height 0 [Pa], and its rise with height [Pa/m], vec2; and `keyframe_values`:
      k_normal, pressure [Pa] or pumped gas [mol/s], by the kind of inflation, shape (W, balloon_count, keyframe_count)
    - of spheres, strings, obstacles, bodies and tubes: see `model.rows`, shape (W, count of them)
    """

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
            raise InputError(f"world: there is no world {world}; expected 0 to {self.world_count - 1}")

    def with_own_parameters(self) -> Self:
        """The same with parameters that may be written, though others use this model."""
        return self._with_parameters(wp.clone)

    def with_rows_of_worlds(self) -> Self:
        """The same with parameters of which each world has its own."""

        def for_each(array: wp.array) -> wp.array:
            if array.size == 0 or array.shape[0] == self.world_count:
                return wp.clone(array)
            rows = np.repeat(array.numpy(), self.world_count, axis=0)
            return wp.array(rows, dtype=array.dtype, device=array.device)

        return self._with_parameters(for_each)

    def of_world(self, world: int, copied: bool = True) -> Self:
        """A batch of a single world, with the parameters that one has.

        Args:
            copied: or else they are views, and change as this model's do.
        """

        def row(array: Any) -> wp.array:
            if array.size == 0 or array.shape[0] == 1:
                return array
            return wp.clone(array[world : world + 1]) if copied else array[world : world + 1]

        return replace(self._with_parameters(row), world_count=1)

    def _with_parameters(self, made_of: Callable[[wp.array], wp.array]) -> Self:
        """With other arrays, each made of one that there is."""
        balloon_numbers, world_numbers = made_of(self.balloon_numbers), made_of(self.world_numbers)
        views = views_of(self.columns, balloon_numbers, world_numbers)
        others = {name: made_of(array) for name, array in self.parameters.items() if name not in views}
        return replace(
            self, balloon_numbers=balloon_numbers, world_numbers=world_numbers, parameters={**views, **others}
        )

    @property
    def own_laws(self) -> tuple[Law, ...]:
        """those of the user"""
        return self.laws[len(LAWS) :]

    @property
    def step_seconds(self) -> float:
        return self.frame_seconds / self.substeps

    @property
    def faces_meet(self) -> bool:
        """whether faces of balloons meet ridges of obstacles and bodies"""
        return bool(self.ridges)

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
    def triangle_faces(self) -> NDArray[np.int64]:
        """the face of each triangle of membranes, in the order of `membrane_corners`"""
        firsts = np.cumsum([0, *(shape.mesh.face_count for shape in self.shapes)])
        faces = (shape.membrane.faces + first for shape, first in zip(self.shapes, firsts, strict=False))
        return np.concatenate(list(faces))

    @property
    def triangle_count(self) -> int:
        """of membranes"""
        return self.membrane_corners.shape[0]

    @property
    def softens(self) -> bool:
        """whether a balloon is of rubber that may"""
        return any(balloon.material.softening is not None for balloon in self.scene.balloon)

    @property
    def bursts(self) -> bool:
        """whether a balloon may"""
        return any(balloon.material.strength is not None for balloon in self.scene.balloon)

    @property
    def balloon_count(self) -> int:
        return len(self.shapes)

    @property
    def sphere_count(self) -> int:
        return self.parameters["sphere_mass"].shape[1]

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
    """Values as a parameter of the model has them.

    Raises:
        InputError: there is no such parameter, or its values have another shape or are not finite.
    """
    if name not in model.parameters:
        raise InputError(f"{name}: there is no such parameter; known are {', '.join(sorted(model.parameters))}")
    shape = model.parameters[name].numpy().shape
    try:
        rows = np.broadcast_to(np.asarray(values, dtype=np.float32), shape)
    except (TypeError, ValueError):
        raise InputError(f"{name}: must be numbers of shape {shape} (got {str(values)[:60]})") from None
    if not np.isfinite(rows).all():
        raise InputError(f"{name}: must be finite (got {str(values)[:60]})")
    return rows
