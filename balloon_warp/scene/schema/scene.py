"""Scene as a whole: its surroundings, and checks that its parts fit together."""

import itertools
import math
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, ModelWrapValidatorHandler, model_validator

from balloon_warp.scene.complaint import LISTS
from balloon_warp.scene.presets import HIGHEST, LOWEST, standard_air
from balloon_warp.scene.schema.balloon import Balloon, Touch
from balloon_warp.scene.schema.fields import (
    MOST_MISSED,
    Color,
    Index,
    LawTables,
    NonNegative,
    Positive,
    Table,
    Vector,
    field_of,
    missed_between_frames,
    optional_field_of,
)
from balloon_warp.scene.schema.solids import Body, Force, Obstacle, Sphere, String


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
