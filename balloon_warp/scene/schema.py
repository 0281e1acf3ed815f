"""The scene schema: every field, its unit, its default and its bounds. SI units throughout."""

import itertools
import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, InstanceOf, model_validator
from pydantic_core import PydanticCustomError

from balloon_warp.mesh import PolygonMesh


def _not_tiny(value: float) -> float:
    """What is divided by must not vanish in float32, nor its square."""
    if value < 1e-12:
        raise PydanticCustomError("tiny", "Input should be at least 1e-12")
    return value


Real = Annotated[float, Field(gt=-1e12, lt=1e12)]
Positive = Annotated[float, Field(gt=0, lt=1e12), AfterValidator(_not_tiny)]
NonNegative = Annotated[float, Field(ge=0, lt=1e12)]
Vector = tuple[Real, Real, Real]
Keyframe = tuple[NonNegative, Real]
"""a time [s] and the value at that time"""
Keyframed = Real | Annotated[list[Keyframe], Field(min_length=1)]
"""a number, or keyframes [[time, value], ...]: linear between them, constant before the first and after the last;
at least a frame apart"""
LawTables = dict[str, dict[str, Real | Vector]]
UnitInterval = Annotated[float, Field(ge=0, le=1)]

HELIUM_MOLAR_MASS = 0.0040026
"""[kg/mol]"""


class Table(BaseModel):
    """A table of the scene file: no unknown fields, no NaN, no infinity."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, arbitrary_types_allowed=True)


class Stiffness(Table):
    """Spring constants k [N/m] of the three kinds of springs (paper, figure 3)."""

    structural: NonNegative = 20.0
    """along the edges of faces"""
    shear: NonNegative = 10.0
    """across faces"""
    flexion: NonNegative = 2.0
    """past one particle, against bending"""
    torsion: NonNegative = 0.0
    """of each edge between two faces, against a change of the angle between them [N m/rad]"""
    variation: UnitInterval = 0.0
    """each spring's constant is drawn uniformly from k (1 - variation) to k (1 + variation)"""
    seed: Annotated[int, Field(ge=0)] = 0
    """of the draws"""
    gradient: tuple[NonNegative, NonNegative] = (1.0, 1.0)
    """factors on the constants of springs at the balloon's lowest and highest coordinate, and linear between them"""
    gradient_axis: Literal["X", "Y", "Z"] = "Y"
    """of the scene, along which they change; where the middles of springs are at the start counts"""
    viscosity: NonNegative = 0.0
    """damping constant of each spring along it, over its spring constant [s] (Tarantino 1996)"""
    yield_stretch: Annotated[float, Field(gt=1, lt=1e12)] | None = None
    """length over rest length from which on a spring is overextended and pulls no more (Tarantino 1996)"""


class Inflation(Table):
    """What fills a balloon.

    - "normal_force", the paper's: each particle is pushed by 100 k_normal (A_p / A_total) along its normal [N].
    - "pressure": a given pressure acts on every face.
    - "gas": a sealed amount of gas does, whose pressure falls as it expands, and which has weight and buoyancy.
    """

    kind: Literal["normal_force", "pressure", "gas"] = "normal_force"
    k_normal: Keyframed = 0.2
    """of "normal_force"; a number or keyframes"""
    pressure: Keyframed = 0.0
    """of "pressure": above the air's [Pa]; a number or keyframes"""
    amount: NonNegative | None = None
    """of "gas", at the start [mol]; what `start_pressure` asks for when missing"""
    start_pressure: Annotated[float, Field(gt=-1e12, lt=1e12)] = 0.0
    """of "gas": above the air's, at the start [Pa]; 0 is in balance with springs at their rest lengths"""
    pump: Keyframed = 0.0
    """of "gas": what is pumped in, and if negative let out [mol/s]; a number or keyframes"""
    gamma: Annotated[float, Field(ge=1, le=10)] = 1.0
    """of "gas": p V^gamma stays as it is. 1 keeps the temperature; without exchange of heat, 1.4 for air, 1.667 for
    helium"""
    molar_mass: NonNegative = HELIUM_MOLAR_MASS
    """of "gas" [kg/mol]"""

    @property
    def keyframed(self) -> Literal["k_normal", "pressure", "pump"]:
        """which field its kind may change with time"""
        return KEYFRAMED_FIELDS[self.kind]

    @property
    def own_fields(self) -> tuple[str, ...]:
        """the fields that its kind has"""
        return FIELDS_OF_KINDS[self.kind]

    @property
    def has_keyframes(self) -> bool:
        """whether the field that may change is given as keyframes"""
        return isinstance(getattr(self, self.keyframed), list)

    @property
    def keyframes(self) -> list[Keyframe]:
        """That field as keyframes; a plain number is one keyframe."""
        value = getattr(self, self.keyframed)
        return value if isinstance(value, list) else [(0.0, value)]

    @model_validator(mode="after")
    def _fields_of_its_kind(self) -> Self:
        for kind, fields in FIELDS_OF_KINDS.items():
            for field in fields if kind != self.kind else ():
                if getattr(self, field) != type(self).model_fields[field].default:
                    raise ValueError(f'{field}: needs kind = "{kind}" (got kind = "{self.kind}")')
        return self

    @model_validator(mode="after")
    def _times_increase(self) -> Self:
        times = [time for time, _ in self.keyframes]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"{self.keyframed}: keyframe times must increase (got {times})")
        return self


FIELDS_OF_KINDS: dict[str, tuple[str, ...]] = {
    "normal_force": ("k_normal",),
    "pressure": ("pressure",),
    "gas": ("amount", "start_pressure", "pump", "gamma", "molar_mass"),
}
KEYFRAMED_FIELDS: dict[str, Literal["k_normal", "pressure", "pump"]] = {
    "normal_force": "k_normal",
    "pressure": "pressure",
    "gas": "pump",
}


class Balloon(Table):
    """A mesh that becomes a balloon."""

    mesh: Path | InstanceOf[PolygonMesh]
    """a mesh file, sought beside the scene file; from Python, a PolygonMesh too"""
    weld: bool = False
    """join faces where vertices of the mesh lie at exactly the same place, as along seams"""
    name: str = ""
    """what its prim is called in the stage; the mesh's name when empty"""
    position: Vector = (0.0, 0.0, 0.0)
    """where the mesh's origin goes [m]"""
    rotation: Vector = (0.0, 0.0, 0.0)
    """about x, then y, then z [degrees], before `position`"""
    scale: Positive = 1.0
    """factor on the mesh's size, before `rotation`"""
    mass: Positive = 0.1
    """of the whole balloon, shared alike by its particles [kg]"""
    helium: Real = 0.0
    """lift for each kilogram of balloon, against gravity's 9.81 [N/kg]"""
    damping: NonNegative = 0.1
    """drag of the whole balloon for each m/s, shared like the mass [N s/m]"""
    drag_coefficient: NonNegative = 0.0
    """C_d of the air's drag, as for a sphere: 1/2 density C_d A u^2, u the speed relative to the wind"""
    stiffness: Stiffness = Stiffness()
    inflation: Inflation = Inflation()
    fixed: list[Annotated[int, Field(ge=0)]] = []
    """particles that do not move, by the order of the file's vertices"""
    color: tuple[UnitInterval, UnitInterval, UnitInterval] | None = None
    """linear RGB; one of the palette when missing"""
    law: LawTables = {}
    """parameters of laws of one's own, by the law's name and the parameter's"""


def _ends_after_its_start(lasting: Any) -> Any:
    if lasting.end is not None and lasting.end < lasting.start:
        raise ValueError(f"end: must not come before the start, {lasting.start:g} s (got {lasting.end:g} s)")
    return lasting


class Sphere(Table):
    """A rigid sphere that collides with balloons and the ground."""

    radius: Positive = 0.15
    """[m]"""
    mass: Positive = 1.0
    """[kg]"""
    position: Vector
    """of its center at the start [m]"""
    velocity: Vector = (0.0, 0.0, 0.0)
    """at the start [m/s]"""
    penalty: NonNegative = 1.0
    """force it gets from a touching particle, as a multiple of that particle's inflation force; without meaning where
    `contact = "impulse"`"""
    color: tuple[UnitInterval, UnitInterval, UnitInterval] | None = None
    start: NonNegative = 0.0
    """when it appears, at its position and velocity [s]; until then nothing touches it"""
    end: NonNegative | None = None
    """when it is gone [s]; never when missing"""

    _lives = model_validator(mode="after")(_ends_after_its_start)


class String(Table):
    """A string from a fixed anchor to one particle: it pulls when taut and does not push."""

    anchor: Vector
    """its fixed end [m]"""
    balloon: Annotated[int, Field(ge=0)] = 0
    """the balloon it holds, by its place in the scene"""
    particle: Annotated[int, Field(ge=0)] | Literal["highest", "lowest"] = "lowest"
    """the particle it holds, by the order of the file's vertices, or along the up axis at the start"""
    length: Positive | None = None
    """[m]; the distance from anchor to particle at the start when missing"""
    stiffness: Positive = 20.0
    """[N/m]"""
    start: NonNegative = 0.0
    """when it is tied [s]"""
    end: NonNegative | None = None
    """when it is cut [s]; never when missing"""

    _lives = model_validator(mode="after")(_ends_after_its_start)


class Ground(Table):
    """A plane across the up axis."""

    height: Real = 0.0
    """[m]"""
    friction: NonNegative = 0.5
    """Coulomb's coefficient, for balloons"""
    restitution: UnitInterval = 0.3
    """rebound speed over impact speed, for spheres"""


class Water(Table):
    """A liquid below a level surface: it presses on the outside of balloons, and brakes what moves in it.

    Inside a balloon it is dry, an open one too: a bowl floats with its rim up. Spheres do not feel it.
    """

    level: Real = 0.0
    """height of its surface [m]"""
    density: Positive = 1000.0
    """[kg/m^3]"""
    drag: NonNegative = 1.0
    """coefficient c of the drag 1/2 density c A |v| v, A the wetted area that moves at v"""


class Change(Table):
    """Values of the scene that change, all at once, while it is simulated."""

    time: NonNegative
    """when [s]; it happens at the first frame that is not before"""
    set: Annotated[dict[str, Any], Field(min_length=1)]
    """the new values by their paths, as in overrides: { "balloon.helium" = 12.0 }. What may change is what may differ
    between worlds, but for places and velocities at the start; and `substeps`, `solver`, `normals`, `correction` and
    `contact`."""


class Atmosphere(Table):
    """The air around the balloons, alike everywhere."""

    pressure: Positive = 101325.0
    """[Pa]"""
    temperature: Positive = 293.15
    """of the air, and of gas at the air's pressure [K]"""
    density: NonNegative | None = None
    """[kg/m^3]; that of dry air as an ideal gas when missing"""
    wind: Vector = (0.0, 0.0, 0.0)
    """its velocity [m/s]"""


class Tube(Table):
    """A tube between two balloons with gas: through it flows the gas that the difference of pressures drives."""

    balloons: tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]
    """which two, by their places in the scene"""
    conductance: NonNegative
    """flow for each pascal between them [mol/(s Pa)]"""


class Scene(Table):
    """One world: balloons, and what is around them."""

    description: str = ""
    """one line, shown by `balloon-warp scenes`"""
    up_axis: Literal["Y", "Z"] = "Y"
    gravity: Real = 9.81
    """[m/s^2], down the up axis"""
    frames: Annotated[int, Field(ge=1)] = 120
    """how many frames follow the start"""
    frames_per_second: Positive = 60.0
    substeps: Annotated[int, Field(ge=1, le=100_000)] | Literal["auto"] = "auto"
    """integration steps in a frame; "auto" takes as many as stability asks"""
    solver: Literal["symplectic_euler", "forward_euler", "projective"] = "symplectic_euler"
    """how a step goes on: v += h a, then x += h v (the paper's listing); or x += h v, then v += h a; or, stable at any
    step, backward Euler by local and global steps (Liu et al. 2013)"""
    solver_iterations: Annotated[int, Field(ge=1, le=10_000)] = 10
    """of "projective", in each substep"""
    correction: Literal["none", "provot", "tarantino"] = "none"
    """after a step, "provot" shortens springs that are longer than (1 + correction_limit) times their rest length to
    that (Provot 1995); with "tarantino" they do not pull there either, as in the paper"""
    correction_limit: Annotated[float, Field(ge=0.001, lt=1e12)] = 0.1
    """strain that is left to springs"""
    correction_sweeps: Annotated[int, Field(ge=1, le=1000)] = 4
    """how often a correction goes through all springs"""
    normals: Literal["cached", "fresh"] = "cached"
    """normals and areas of the inflation: refreshed once a frame (the paper), or every substep"""
    contact: Literal["penalty", "impulse"] = "penalty"
    """what a sphere gets from a touching particle: a force in proportion to the balloon's inflation (the paper); or the
    momentum that the particle loses, so that balloons and spheres together keep theirs"""
    net_forces: bool = False
    """write the net force on each particle into the stage, as curves"""
    picture_frame: Annotated[int, Field(ge=0)] | None = None
    """the frame that a picture of this scene shows; the last when missing or past the end"""
    balloon: Annotated[list[Balloon], Field(min_length=1)]
    sphere: list[Sphere] = []
    string: list[String] = []
    ground: Ground | None = None
    water: Water | None = None
    tube: list[Tube] = []
    atmosphere: Atmosphere = Atmosphere()
    law: LawTables = {}
    """parameters of laws of one's own that belong to the world, by the law's name and the parameter's"""
    change: list[Change] = []
    """what changes while it is simulated, in order of time"""

    @property
    def up(self) -> Vector:
        """unit vector of the up axis"""
        return (0.0, 1.0, 0.0) if self.up_axis == "Y" else (0.0, 0.0, 1.0)

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        for number, string in enumerate(self.string):
            if string.balloon >= len(self.balloon):
                raise ValueError(
                    f"string.{number}.balloon: must be below the number of balloons, {len(self.balloon)} "
                    f"(got {string.balloon})"
                )
        times = [change.time for change in self.change]
        if any(later < earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"change: times must not decrease (got {times})")
        for number, balloon in enumerate(self.balloon):
            inflation = balloon.inflation
            times = [time for time, _ in inflation.keyframes]
            shortest = min((later - earlier for earlier, later in itertools.pairwise(times)), default=math.inf)
            if shortest * self.frames_per_second < 1.0 - 1e-6:
                raise ValueError(
                    f"balloon.{number}.inflation.{inflation.keyframed}: keyframes must be at least a frame apart, "
                    f"{1.0 / self.frames_per_second:g} s (got {shortest:g} s)"
                )
            if inflation.kind == "gas" and balloon.helium:
                raise ValueError(f"balloon.{number}.helium: must be 0, its gas lifts it (got {balloon.helium:g})")
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
