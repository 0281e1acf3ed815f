"""Scene as a whole: its surroundings and solids, and checks that its parts fit together."""

import itertools
import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, InstanceOf, ModelWrapValidatorHandler, model_validator

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.load import is_mesh, mesh_from
from balloon_warp.mesh.polygon_mesh import Unit, UpAxis
from balloon_warp.scene.balloon import Balloon, Touch
from balloon_warp.scene.fields import (
    HIGHEST,
    LISTS,
    LOWEST,
    MOST_MISSED,
    Color,
    Index,
    LawTables,
    NonNegative,
    Positive,
    Prim,
    Table,
    UnitInterval,
    Vector,
    field_of,
    missed_between_frames,
    optional_field_of,
    pins_of,
    standard_air,
)

ShapeKind = Literal["box", "capsule", "plane", "mesh"]
FIELDS_OF_SHAPES: dict[ShapeKind, tuple[str, ...]] = {
    "box": ("size",),
    "capsule": ("radius", "length"),
    "plane": (),
    "mesh": ("mesh", "prim", "unit", "up", "scale"),
}
"""Fields that only some shapes have"""


def _mesh_of(given: Any) -> Any:
    """Convert a mesh-like Python value to a mesh.

    File names and values of other types pass unchanged.
    """
    return mesh_from(given) if is_mesh(given) else given


class Solid(Table):
    """Shape and placement of a solid."""

    shape: ShapeKind = "box"
    """Shape; when left out, it follows from the fields that are given. A "plane" fills the half space below it; a
    "capsule" stands along the up axis, as a plane's normal does; a "mesh" that is not closed is a thin sheet, and so is
    an obstacle's mesh whose faces look inward: a room"""
    size: tuple[Positive, Positive, Positive] = (1.0, 1.0, 1.0)
    """Edge lengths of a box [m]"""
    radius: Positive = 0.1
    """Radius of a capsule [m]"""
    length: NonNegative = 1.0
    """Distance between the centers of a capsule's two ends [m]; 0 makes it a ball"""
    mesh: Annotated[Path | InstanceOf[PolygonMesh] | None, BeforeValidator(_mesh_of)] = None
    """Mesh file, sought beside the scene file. In Python also a PolygonMesh, a trimesh.Trimesh, or points and faces"""
    prim: Prim | None = None
    """Object of the mesh file, or a list of several: in a USD stage the path of a prim, such as "/Room/Wall0", or of
    what it stands in; in an OBJ file an object or a group, in a glTF file a node or a mesh, by name. When missing, all
    that the file shows: of a stage, what is visible and of purpose "default" or "render" """
    unit: Unit | None = None
    """Unit of the mesh's coordinates; when missing, the unit in the mesh file, else the meter"""
    up: UpAxis | None = None
    """Up axis of the mesh file; when missing, the one in the file, else "Y". The mesh is turned so that this axis
    points up in the scene"""
    scale: Positive = 1.0
    """Factor on the mesh's size"""
    position: Vector = (0.0, 0.0, 0.0)
    """Position of the center, of a plane's surface, or of the mesh's origin [m]"""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Rotation about x, then y, then z, applied before `position` [degrees]"""

    @model_validator(mode="before")
    @classmethod
    def _shape_of_what_is_given(cls, given: Any) -> Any:
        if not isinstance(given, dict) or given.get("shape") is not None:
            return given
        fitting = (shape for shape, fields in FIELDS_OF_SHAPES.items() if not given.keys().isdisjoint(fields))
        return given | {"shape": next(fitting, "box")}

    @model_validator(mode="after")
    def _fields_of_its_shape(self) -> Self:
        for shape, fields in FIELDS_OF_SHAPES.items():
            for field in fields if shape != self.shape else ():
                if getattr(self, field) != type(self).model_fields[field].default:
                    raise ValueError(f'{field}: needs shape = "{shape}" (got shape = "{self.shape}")')
        if self.shape == "mesh" and self.mesh is None:
            raise ValueError('mesh: is missing; shape = "mesh" needs a mesh file')
        return self


Moved = tuple[NonNegative, Vector] | tuple[NonNegative, Vector, Vector]
"""Time [s], shift from `position` [m], and rotation on top of `rotation` [degrees]"""


class Obstacle(Solid):
    """Rigid obstacle that balloons and spheres cannot enter: fixed, or moved as the scene says, whatever pushes it."""

    motion: Annotated[list[Moved], Field(min_length=1)] | None = None
    """Keyframes [[time, shift], ...] or [[time, shift, turn], ...]: shifts from `position` [m], turns on top of
    `rotation` about x, then y, then z [degrees]; linear between them, and constant before the first and after the last.
    When missing, a mesh of a USD stage moves by its time samples"""
    friction: NonNegative = 0.5
    """Coulomb friction coefficient [1]"""
    restitution: UnitInterval = 0.3
    """Coefficient of restitution for spheres [1]"""
    thickness: NonNegative | None = None
    """Distance from the surface at which balloons are held, half the thickness of a sheet [m]; 0 when missing, and a
    thousandth of its size for a sheet"""
    name: str = ""
    """Name of the prim in the stage; the shape's name when empty"""
    color: Color | None = None
    """Linear RGB, or a color of the web, "red" or "#ff8000"; when missing, the color in the mesh file, else gray"""

    @model_validator(mode="after")
    def _times_increase(self) -> Self:
        times = [keyframe[0] for keyframe in self.motion or ()]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"motion: keyframe times must increase (got {times})")
        return self


class Body(Solid):
    """Free rigid body, with mass and inertia: balloons press on it and carry it.

    It falls, turns and meets spheres, obstacles, the ground and other bodies.
    """

    shape: Literal["box", "capsule", "mesh"] = "box"  # pyright: ignore[reportIncompatibleVariableOverride]
    """Shape; when left out, it follows from the fields that are given. A "capsule" stands along the up axis; a "mesh"
    that is not closed is a sheet, and needs a thickness"""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity of the center of mass at the start [m/s]"""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """Angular velocity at the start about the center of mass, along the axes of the scene [rad/s]"""
    mass: Positive | None = None
    """Mass [kg]; when missing, it follows from `density`, or is 1 kg"""
    density: Positive | None = None
    """Density of the material that fills the body, or of a sheet's material [kg/m^3]; instead of `mass`"""
    friction: NonNegative = 0.5
    """Coulomb friction coefficient; a contact takes the geometric mean of both, if a balloon has one of its own [1]"""
    restitution: UnitInterval = 0.3
    """Coefficient of restitution; a contact takes the geometric mean of both [1]"""
    thickness: NonNegative | None = None
    """Distance from the surface at which others are held, half the thickness of a sheet [m]; 0 when missing"""
    name: str = ""
    """Name of the prim in the stage; the shape's name when empty"""
    color: Color | None = None
    """Linear RGB, or a color of the web, "red" or "#ff8000"; when missing, the color in the mesh file, else a color of
    the palette"""

    @model_validator(mode="after")
    def _weighs_something(self) -> Self:
        if self.mass is not None and self.density is not None:
            raise ValueError(f"density: must be left out where mass is given (got {self.density:g} and {self.mass:g})")
        return self


def _ends_after_its_start(lasting: Any) -> Any:
    if lasting.end is not None and lasting.end < lasting.start:
        raise ValueError(f"end: must not come before the start, {lasting.start:g} s (got {lasting.end:g} s)")
    return lasting


class Sphere(Table):
    """A rigid sphere that collides with balloons, spheres, obstacles and the ground."""

    radius: Positive = 0.15
    """Radius [m]"""
    mass: Positive = 1.0
    """Mass [kg]"""
    position: Vector
    """Position of the center at the start [m]"""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity at the start [m/s]"""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """Angular velocity at the start [rad/s]; it has no effect without friction"""
    penalty: NonNegative = 1.0
    """Contact force on the sphere as a multiple of the touching particle's inflation force; it has no effect with
    `contact = "impulse"`"""
    restitution: UnitInterval = 0.3
    """Coefficient of restitution between spheres; of two different ones, their geometric mean [1]"""
    friction: NonNegative = 0.0
    """Coulomb friction coefficient; a contact takes the geometric mean of both, so that 0 slides on everything and does
    not turn. Against balloons it acts with `contact = "impulse"`, or where the sphere is small and touches faces [1]"""
    color: Color | None = None
    """Linear RGB, or a color of the web, "red" or "#ff8000"; a color of the palette when missing"""
    start: NonNegative = 0.0
    """Time at which the sphere appears, at its position and velocity [s]; until then nothing touches it"""
    end: NonNegative | None = None
    """Time at which the sphere disappears [s]; never when missing"""

    law: LawTables = {}
    """Parameters of phases of the step that are of spheres, by phase and name"""

    _lives = model_validator(mode="after")(_ends_after_its_start)


class String(Table):
    """A string from an anchor to one particle: it pulls when taut and does not push."""

    anchor: Vector
    """Position of the anchored end [m]; with `obstacle` or `body`, in its own axes from its `position`"""
    obstacle: Index | None = None
    """Obstacle that carries the anchor, by its index in the scene: the anchor moves and turns with it. Fixed in the
    scene when missing"""
    body: Index | None = None
    """Free body that carries the anchor, by its index in the scene, and that the string pulls as hard as the balloon:
    a basket"""
    motion: Annotated[list[tuple[NonNegative, Vector]], Field(min_length=1)] | None = None
    """Keyframes [[time, shift], ...]: shifts from `anchor` [m], linear between them, and constant before the first and
    after the last, as of a hand"""
    balloon: Index = 0
    """Balloon that the string holds, by its index in the scene"""
    particle: Index | Literal["highest", "lowest"] = "lowest"
    """Particle that the string holds, by the order of the file's vertices, counted from 0, or by its place along the up
    axis at the start"""
    length: Positive | None = None
    """Length [m]; the distance from anchor to particle at the start when missing"""
    stiffness: Positive = 20.0
    """Spring constant [N/m]"""
    start: NonNegative = 0.0
    """Time at which the string is tied [s]"""
    end: NonNegative | None = None
    """Time at which the string is cut [s]; never when missing"""
    knot: bool = True
    """Draw the balloon's neck and a knot at the string; they are not simulated, and foil has none"""

    _lives = model_validator(mode="after")(_ends_after_its_start)

    @property
    def moves(self) -> bool:
        """Return whether the anchor may move."""
        return any(each is not None for each in (self.obstacle, self.body, self.motion))

    @model_validator(mode="after")
    def _follows_one(self) -> Self:
        followed = [name for name in ("obstacle", "body", "motion") if getattr(self, name) is not None]
        if len(followed) > 1:
            raise ValueError(f"{followed[1]}: an anchor follows an obstacle, a body or keyframes; expected one of them")
        times = [time for time, _ in self.motion or ()]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"motion: keyframe times must increase (got {times})")
        return self


Particles = list[Index | Annotated[str, Field(min_length=1)]]


class Force(Table):
    """Outer force on some of a balloon's particles, such as the push of a hand or of a motor."""

    balloon: Index = 0
    """Balloon that the force acts on, by its index in the scene"""
    particles: Annotated[Annotated[Particles, Field(min_length=1)], BeforeValidator(pins_of)] | None = None
    """Particles that share the force by their masses: vertices of the file, counted from 0, or all of a group of the
    mesh, by its name; all of the balloon when missing. Fixed ones take no share. In Python also a mask"""
    newtons: Vector = (0.0, 0.0, 0.0)
    """Force on them together, along the axes of the scene [N]"""


class Box(Table):
    """Box in which the table of a batch counts balloons, as `in_box`: those whose centers are inside."""

    lower: Vector
    """Corner of the least coordinates [m]"""
    upper: Vector
    """Corner of the greatest coordinates [m]"""

    @model_validator(mode="after")
    def _has_an_inside(self) -> Self:
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"upper: must be above lower in every coordinate (got {self.upper}, lower {self.lower})")
        return self


class Picture(Table):
    """Camera and light of the scene's picture. Options for the camera have precedence."""

    azimuth: Annotated[float, Field(ge=-360, le=360)] | None = None
    """Azimuth of the camera from the front, +Z, or -Y where Z is up, toward +X [degrees]; 32 when missing"""
    elevation: Annotated[float, Field(ge=0, le=90)] | None = None
    """Elevation of the camera above the horizon [degrees]; 13 when missing"""
    zoom: Annotated[float, Field(ge=0.01, le=100)] = 1.0
    """Zoom factor; with 1 the whole animation just fits in"""
    look_at: Vector | None = None
    """Point in the middle of the picture [m]; when missing, the middle of the whole animation"""
    paper: Color | None = None
    """Color of the paper that is the ground and the backdrop; a warm white when missing"""
    light: Annotated[float, Field(ge=-180, le=180)] | None = None
    """Azimuth of the main light, from the camera toward its right: with 90 it shines from the right, with 180 from
    behind the scene [degrees]; -45 when missing"""


class Atmosphere(Table):
    """Air around the balloons, uniform unless it has a `lapse` or `altitude`, `shear`, `roughness` or `gusts`."""

    altitude: Annotated[float, Field(ge=LOWEST, le=HIGHEST)] | None = None
    """Altitude of the scene's height 0 above sea: `pressure`, `temperature` and `lapse` that are not given are those of
    the U.S. Standard Atmosphere 1976 there [m]"""
    pressure: float = field_of("air_pressure")
    """Air pressure [Pa]; 101325.0 when missing"""
    temperature: float = field_of("air_temperature")
    """Temperature of the air, and of gas at its pressure [K]; 293.15 when missing"""
    density: float | None = optional_field_of("air_density")
    """Density of the air; when missing, that of dry air as an ideal gas [kg/m^3]"""
    lapse: float | None = optional_field_of("air_lapse")
    """Lapse rate, the decrease of temperature with height: 0.0065 in the standard atmosphere up to 11 km, 0 isothermal,
    below 0 where it is warmer above. Pressure and density, given at height 0, fall with height. Uniform air when
    missing [K/m]"""
    wind: Vector = field_of("wind")
    """Wind velocity [m/s]; [0.0, 0.0, 0.0] when missing"""
    shear: float = field_of("wind_shear")
    """Exponent of the wind's power law, from no wind at height 0 up to ten times `wind_height`: 0.14 over open land,
    0.3 in towns, 0 uniform [1]; 0.0 when missing"""
    wind_height: float = field_of("wind_height")
    """Height at which `wind` is given, where it grows with height [m]; 10.0 when missing"""
    roughness: float = field_of("wind_roughness")
    """Roughness length of the ground in the wind's logarithmic law, up to ten times `wind_height`: 0.0002 over the open
    sea, 0.03 over grass, 0.25 over high crops, 1 in suburbs; 0 is none; or else `shear` [m]; 0.0 when missing"""
    gusts: float = field_of("gusts")
    """Turbulence intensity: root mean square of each component of the gusts' velocity over the wind speed; 0.1 on a
    calm day, 0.3 in streets [1]; 0.0 when missing"""
    gust_length: float = field_of("gust_length")
    """Integral length scale of the turbulence [m]; 10.0 when missing"""
    gust_seed: int = field_of("gust_seed")
    """Seed of the random gusts [1]; 0 when missing"""

    @property
    def following(self) -> frozenset[str]:
        """Fields that follow from an altitude, since they were not given."""
        return frozenset(standard_air(0.0)) - self.model_fields_set

    @model_validator(mode="wrap")
    @classmethod
    def _of_the_altitude(cls, given: Any, checked: ModelWrapValidatorHandler[Self]) -> Self:
        air = checked(given)
        if not isinstance(given, dict) or air.altitude is None:
            return air
        following = {name: value for name, value in standard_air(air.altitude).items() if name not in given}
        air = checked(given | following)
        air.model_fields_set.difference_update(following)
        return air


class Ground(Table):
    """Ground plane across the up axis."""

    height: float = field_of("ground_height")
    """Height of the ground [m]; 0.0 when missing"""
    friction: float = field_of("ground_friction")
    """Coulomb friction coefficient [1]; 0.5 when missing"""
    restitution: float = field_of("ground_restitution")
    """Coefficient of restitution for spheres [1]; 0.3 when missing"""


class Water(Table):
    """Liquid below a level surface: it presses on the outside of balloons, and brakes what moves in it.

    Inside a balloon it is dry, an open one too: a bowl floats with its rim up. Spheres do not feel it.
    """

    level: float = field_of("water_level")
    """Height of the surface [m]; 0.0 when missing"""
    density: float = field_of("water_density")
    """Density [kg/m^3]; 1000.0 when missing"""
    drag: float = field_of("water_drag")
    """Drag coefficient c of 1/2 density c A |v| v, where A is the wetted area moving at v [1]; 1.0 when missing"""


MESHED = ("balloon", "obstacle", "body")
"""Lists of the scene whose tables may have a mesh"""
WITHOUT_MESHES = {name: {"__all__": {"mesh"}} for name in MESHED}
"""Fields to leave out of a scene that is dumped as plain values: meshes made in Python have no plain value"""


class Tube(Table):
    """Tube between two gas balloons: gas flows through it, driven by the pressure difference."""

    balloons: tuple[Index, Index]
    """Indices of the two balloons in the scene"""
    conductance: NonNegative
    """Conductance: flow per pascal of pressure difference [mol/(s Pa)]"""


class Change(Table):
    """Change of some of the scene's values at one time during the simulation."""

    time: NonNegative
    """Time of the change [s]; it takes effect at the first frame at or after it"""
    set: Annotated[dict[str, Any], Field(min_length=1)]
    """New values by their paths, as in overrides: { "balloon.helium" = 12.0 }. All values that may vary between worlds
    may change, except positions and velocities at the start; and so may `substeps`, `solver`, `normals`, `correction`
    and `contact`. Keyframes keep their times."""


def _touch_of(given: Any) -> Any:
    """Return the table that `true` stands for, and any other value as it is."""
    return {} if given is True else given


class Scene(Table):
    """World of balloons and their surroundings."""

    description: str = ""
    """Summary in one line, shown by `balloon-warp scenes`"""
    up_axis: Literal["Y", "Z"] = "Y"
    """Axis that points up"""
    gravity: float = field_of("gravity")
    """Gravitational acceleration against the up axis [m/s^2]; 9.81 when missing"""
    frames: Annotated[int, Field(ge=1)] = 120
    """Number of frames after the start"""
    frames_per_second: Positive = 60.0
    """Frame rate [1/s]"""
    substeps: Annotated[int, Field(ge=1, le=100_000)] | Literal["auto"] = "auto"
    """Integration steps per frame; "auto" takes as many as stability requires, for balloons, bodies and spheres"""
    solver: Literal["symplectic_euler", "forward_euler", "projective"] = "symplectic_euler"
    """Time integrator: "symplectic_euler" v += h a, then x += h v (the paper's listing); "forward_euler" x += h v, then
    v += h a; "projective" backward Euler by local and global steps (Liu et al. 2013), stable at any step"""
    solver_iterations: Annotated[int, Field(ge=1, le=10_000)] | Literal["auto"] = "auto"
    """Iterations of "projective" in each substep; "auto" makes 10 to 200, until they change little"""
    correction: Literal["none", "provot", "tarantino"] = "none"
    """Position correction after a step: "provot" shortens springs that are longer than (1 + correction_limit) times
    their rest length to that length (Provot 1995); with "tarantino" such springs also pull nothing there, as in the
    paper, and ever less up to there"""
    correction_limit: float = field_of("correction_limit")
    """Strain beyond which a spring is shortened [1]; 0.1 when missing"""
    correction_sweeps: Annotated[int, Field(ge=1, le=1000)] = 4
    """Number of passes of the correction over all springs"""
    normals: Literal["cached", "fresh"] = "fresh"
    """Update of the normals and areas in the paper's inflation, "normal_force": "cached" once a frame, as in the paper,
    or "fresh" every substep"""
    contact: Literal["penalty", "impulse"] = "penalty"
    """Response of a sphere to a touching particle: "penalty", a force proportional to the balloon's inflation (the
    paper); or "impulse", the momentum that the particle loses, which conserves momentum and adds no energy"""
    faces: bool | Literal["auto"] = "auto"
    """Contact of balloon faces, not only of particles, with edges and corners of obstacles and bodies, with capsules,
    and with spheres: small ones, and with `contact = "impulse"` all; "auto" where an obstacle, a body, a part of one or
    a sphere is thin compared with faces, and where a box has no side that is nearly level"""
    contacts: bool = False
    """Record contact forces, torques, areas and pressures of each pair, in frames and in the stage"""
    net_forces: bool = False
    """Write the net force on each particle into the stage, as curves"""
    picture_frame: Index | None = None
    """Frame that a picture of this scene shows; the last when missing or past the end"""
    picture: Picture | None = None
    """Camera of the scene's picture, unless an option says otherwise."""
    balloon: Annotated[list[Balloon], Field(min_length=1)]
    """Balloon, made from a mesh."""
    sphere: list[Sphere] = []
    """Rigid sphere that collides with balloons, spheres, obstacles and the ground."""
    string: list[String] = []
    """String from an anchor to one particle: it pulls when taut and does not push."""
    obstacle: list[Obstacle] = []
    """Rigid obstacle that balloons and spheres cannot enter: it stays, or moves as the scene says, whatever pushes
    it."""
    body: list[Body] = []
    """Free rigid body, with mass and inertia: balloons press on it and carry it."""
    ground: Ground | None = None
    """Ground plane across the up axis."""
    water: Water | None = None
    """Liquid below a level surface: it presses on the outside of balloons, and brakes what moves in it."""
    tube: list[Tube] = []
    """Tube between two gas balloons: gas flows through it, driven by the pressure difference."""
    force: list[Force] = []
    """Outer force on some of a balloon's particles, such as the push of a hand or of a motor."""
    touch: Annotated[Touch | Literal[False], BeforeValidator(_touch_of)] | None = None
    """Contact between surfaces of balloons. When missing, balloons touch each other, and themselves where parts of a
    mesh are near each other, unless one may burst or the solver is "projective"; with `touch = false` they pass through
    each other."""
    box: Box | None = None
    """Box in which the table of a batch counts balloons, as `in_box`: those whose centers are inside."""
    atmosphere: Atmosphere = Atmosphere()
    """Air around the balloons, uniform unless it has a `lapse` or `altitude`, `shear`, `roughness` or `gusts`."""
    law: LawTables = {}
    """World parameters of user-defined laws, by law and name"""
    change: list[Change] = []
    """Changes during the simulation, in order of time"""

    @property
    def up(self) -> Vector:
        """Direction of the up axis, a unit vector."""
        return (0.0, 1.0, 0.0) if self.up_axis == "Y" else (0.0, 0.0, 1.0)

    @property
    def touches(self) -> bool:
        """Return whether any surfaces can touch."""
        among = self._can_touch if self.touch is None else bool(self.touch) and self.touch.balloons
        return self.touches_itself or (among and len(self.balloon) > 1)

    @property
    def meshes_settle_itself(self) -> bool:
        """Return whether the meshes decide if balloons touch themselves."""
        leaves_it = self.touch is None or (bool(self.touch) and self.touch.itself == "auto")
        return leaves_it and self._can_touch

    @property
    def _can_touch(self) -> bool:
        """Return whether contact of balloons can be simulated, so that they touch where the scene says nothing."""
        solvers = {self.solver, *(change.set.get("solver") for change in self.change)}
        return "projective" not in solvers and not self._bursts

    @property
    def _bursts(self) -> bool:
        """Return whether a balloon may burst."""
        return any(balloon.material.strength is not None for balloon in self.balloon)

    @property
    def touches_spheres(self) -> bool:
        """Return whether small spheres touch faces, not only particles."""
        if self.touch and self.faces is not True:
            return self.touch.spheres and bool(self.sphere)
        return self.faces_may_meet and bool(self.sphere)

    @property
    def faces_may_meet(self) -> bool:
        """Return whether faces of balloons, and not only their particles, meet thin things."""
        if self.faces != "auto":
            return self.faces
        return self.solver != "projective" and not self._bursts

    @property
    def touches_itself(self) -> bool:
        """Return whether parts of a balloon can touch each other; not yet where their meshes are to settle it."""
        return bool(self.touch) and self.touch.itself in (True, "soft")

    @property
    def touches_softly(self) -> bool:
        """Return whether parts of a balloon touch each other softly, as those of slender ones do."""
        return bool(self.touch) and self.touch.itself == "soft"

    @model_validator(mode="before")
    @classmethod
    def _lists(cls, given: Any) -> Any:
        for name, each in given.items() if isinstance(given, dict) else ():
            if name in LISTS and isinstance(each, Table):
                one = type(each).__name__
                raise ValueError(f"{name}: is one {one}; expected a list of them, {name}=[{one}(...)]")
        return given

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        for name, things in (("string", self.string), ("force", self.force)):
            for number, thing in enumerate(things):
                if thing.balloon >= len(self.balloon):
                    raise ValueError(
                        f"{name}.{number}.balloon: must be below the number of balloons, {len(self.balloon)} "
                        f"(got {thing.balloon})"
                    )
        for number, string in enumerate(self.string):
            carriers = ("obstacle", "obstacles", self.obstacle), ("body", "bodies", self.body)
            for field, words, things in carriers:
                if (carrier := getattr(string, field)) is not None and carrier >= len(things):
                    raise ValueError(
                        f"string.{number}.{field}: must be below the number of {words}, {len(things)} (got {carrier})"
                    )
            if string.moves and self.solver == "projective":
                raise ValueError(f'string.{number}: an anchor that moves needs another solver than "projective"')
        if self.correction != "none" and not any(
            not balloon.material.is_membrane or balloon.material.springs for balloon in self.balloon
        ):
            raise ValueError(
                f'correction: "{self.correction}" shortens springs, and no balloon has any; expected "none", or a '
                'material with `springs`, or kind = "springs"'
            )
        times = [change.time for change in self.change]
        if any(later < earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"change: times must not decrease (got {times})")
        for number, balloon in enumerate(self.balloon):
            inflation = balloon.inflation
            times = [time for time, _ in inflation.keyframes] if inflation.has_keyframes else []
            shortest = min((later - earlier for earlier, later in itertools.pairwise(times)), default=math.inf)
            too_close = shortest * self.frames_per_second < 1.0 - 1e-6
            if too_close and missed_between_frames(inflation.keyframes, 1.0 / self.frames_per_second) > MOST_MISSED:
                raise ValueError(
                    f"balloon.{number}.inflation.{inflation.keyframed}: keyframes must be at least a frame apart, "
                    f"{1.0 / self.frames_per_second:g} s, or change little within one (got {shortest:g} s)"
                )
            if inflation.kind == "gas" and balloon.helium:
                raise ValueError(f"balloon.{number}.helium: must be 0, since its gas lifts it (got {balloon.helium:g})")
        for number, tube in enumerate(self.tube):
            self._check_tube(number, tube)
        return self

    def _check_tube(self, number: int, tube: Tube) -> None:
        first, second = tube.balloons
        if first == second or max(tube.balloons) >= len(self.balloon):
            raise ValueError(
                f"tube.{number}.balloons: must be two balloons below the number of balloons, {len(self.balloon)} "
                f"(got {first} and {second})"
            )
        ends = self.balloon[first].inflation, self.balloon[second].inflation
        if any(end.kind != "gas" for end in ends):
            raise ValueError(f'tube.{number}.balloons: both must have inflation.kind = "gas"')
        if ends[0].gamma != ends[1].gamma or ends[0].molar_mass != ends[1].molar_mass:
            raise ValueError(f"tube.{number}.balloons: both must have the same gamma and molar_mass")
