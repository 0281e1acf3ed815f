"""Balloons: their meshes, springs, material, inflation and touch."""

import itertools
import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BeforeValidator, Field, InstanceOf, ModelWrapValidatorHandler, model_validator

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.law import FAR
from balloon_warp.kernels.laws.membrane import GENT_LIMIT, NEVER, OGDEN_EXPONENTS
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.crossings import Taken
from balloon_warp.mesh.load import LARGEST_GAP, LEAST_GAP, Holes, Parts, Treatment, is_mesh, load_mesh, mesh_from
from balloon_warp.mesh.polygon_mesh import Unit, UpAxis
from balloon_warp.scene.fields import (
    PRESETS,
    Color,
    Index,
    Keyframe,
    Keyframed,
    LawTables,
    NonNegative,
    Positive,
    Prim,
    Real,
    Rule,
    Table,
    UnitInterval,
    Vector,
    field_of,
    optional_field_of,
    pinned_by,
    pins_of,
    weighed_by,
)


class Inflation(Table):
    """Inflation of a balloon: a pressure, a sealed gas, or the paper's normal forces.

    - "pressure": a given pressure acts on every face. On a closed mesh its forces sum to zero.
    - "gas": a sealed amount of gas, whose pressure falls as it expands, and which has weight and buoyancy.
    - "normal_force", the paper's: each particle is pushed by 100 k_normal (A_p / A_total) along its normal [N]. These
      forces do not sum to zero, and the effect of k_normal depends on how the mesh is divided into faces.
    """

    kind: Literal["pressure", "gas", "normal_force"] = "pressure"
    """Kind of inflation; if left out, it follows from the fields that are given, and without any it is a pressure"""
    pressure: Literal["auto"] | Keyframed = "auto"
    """Gauge pressure of kind "pressure" [Pa]: a number or keyframes; or "auto", which rises within a second to the
    pressure that gives about the `stretch`, whatever the balloon's size, mesh and springs"""
    stretch: UnitInterval = 0.25
    """Stretch of the skin that the pressure "auto" aims at, as of a sphere; 0.1 makes the volume a third larger.
    Without effect on other pressures"""
    k_normal: Keyframed = 0.2
    """Coefficient of kind "normal_force": a hundredth of the sum of all forces' sizes [N]; a number or keyframes"""
    amount: NonNegative | None = None
    """Amount of gas at the start, of kind "gas" [mol]; when missing, the amount that gives `start_pressure`"""
    start_pressure: Real = 0.0
    """Gauge pressure at the start, of kind "gas" [Pa]; 0 is in equilibrium with springs at their rest lengths"""
    pump: Keyframed = 0.0
    """Flow into the balloon, negative outward, of kind "gas" [mol/s]; a number or keyframes"""
    pump_curve: list[tuple[NonNegative, NonNegative]] = []
    """Characteristic curve of a pump, of kind "gas": flow against gauge pressure, [[pressure, flow], ...] [Pa] and
    [mol/s], linear between points, and zero beyond the last"""
    breaths: float = field_of("fill_breaths")
    """Number of deep breaths blown into the balloon, of kind "gas", each of 3.5 l at ambient pressure, an adult's
    inspiratory capacity [1]; 0.0 when missing"""
    litres: float = field_of("fill_litres")
    """Volume of gas at ambient pressure blown into the balloon, of kind "gas" [l]; 0.0 when missing"""
    moles: float = field_of("fill_moles")
    """Amount of gas blown into the balloon, of kind "gas" [mol]; 0.0 when missing"""
    fill_time: float = field_of("fill_time")
    """Time in which breaths, litres or moles are blown in, at a constant rate from the start, of kind "gas"; with
    `fill_to_pressure` or `fill_to_diameter`, the time of each breath [s]; 1.0 when missing"""
    fill_to_pressure: float = field_of("fill_to_pressure")
    """Gauge pressure at which blowing stops, of kind "gas"; 0 sets no such limit [Pa]; 0.0 when missing"""
    fill_to_diameter: float = field_of("fill_to_diameter")
    """Diameter of the sphere of equal volume at which blowing stops, of kind "gas"; 0 sets no such limit [m]; 0.0 when
    missing"""
    gamma: float = field_of("gamma")
    """Polytropic exponent of a sealed gas, p V^gamma constant: 1 isothermal, 1.4 adiabatic air, 1.667 adiabatic helium
    [1]; 1.0 when missing"""
    breathing_damping: float = field_of("breathing_damping")
    """Numerical damping of the breathing mode, the quick oscillation of a gas balloon's volume: 1 backward Euler, 0
    none by the trapezoidal rule, so that balloons breathe on [1]; 1.0 when missing"""
    molar_mass: float = field_of("molar_mass")
    """Molar mass [kg/mol]; 0.0040026 when missing"""
    added_mass: float = field_of("added_mass")
    """Added mass coefficient of a gas balloon, as a fraction of the displaced air's mass: 0.5 for a sphere, 0 for none
    [1]; 0.5 when missing"""
    leak: float = field_of("leak")
    """Area of the leak through pores and pinholes, which gives no thrust, of kind "gas" [m^2]; 0.0 when missing"""
    water_evened: UnitInterval | None = optional_field_of("water_evened")
    """Part of a liquid's pressure that lifts a balloon of kind "gas" as a whole, and does not press on its skin from
    place to place; what the skin does not bear when missing [1]"""

    @property
    def keyframed(self) -> Literal["k_normal", "pressure", "pump"]:
        """Name of the field that may have keyframes, by the kind of inflation."""
        return KEYFRAMED_FIELDS[self.kind]

    @property
    def own_fields(self) -> tuple[str, ...]:
        """Names of the fields that the kind of inflation has."""
        return FIELDS_OF_KINDS[self.kind]

    @property
    def has_keyframes(self) -> bool:
        """Return whether the keyframed field is given as keyframes."""
        return isinstance(getattr(self, self.keyframed), list)

    @property
    def is_automatic(self) -> bool:
        """Return whether the pressure is "auto"."""
        return self.kind == "pressure" and self.pressure == "auto"

    @property
    def says_how_much(self) -> bool:
        """Return whether an amount of gas, or a flow, is given."""
        return any(getattr(self, field) not in (None, 0.0, []) for field in (*MUCH, *FAST, "start_pressure"))

    @property
    def keyframes(self) -> list[Keyframe]:
        """Values of the keyframed field as keyframes.

        A plain number is one keyframe, and a pressure "auto" is NaN.
        """
        if self.is_automatic:
            return [(0.0, 0.0), (AUTO_SECONDS, math.nan)]
        value = getattr(self, self.keyframed)
        return value if isinstance(value, list) else [(0.0, value)]

    @property
    def names_its_kind(self) -> bool:
        """Return whether the kind was given; otherwise fields of another kind imply that kind."""
        return "kind" in self.model_fields_set

    @model_validator(mode="wrap")
    @classmethod
    def _kind_of_what_is_given(cls, given: Any, checked: ModelWrapValidatorHandler[Self]) -> Self:
        if not isinstance(given, dict) or given.get("kind") is not None:
            return checked(given)
        fitting = (kind for kind, fields in FIELDS_OF_KINDS.items() if not given.keys().isdisjoint(fields))
        inflation = checked(given | {"kind": next(fitting, "pressure")})
        inflation.model_fields_set.discard("kind")
        return inflation

    @model_validator(mode="after")
    def _fields_of_its_kind(self) -> Self:
        for kind, fields in FIELDS_OF_KINDS.items():
            for field in fields if kind != self.kind else ():
                if getattr(self, field) != type(self).model_fields[field].default:
                    raise ValueError(f'{field}: needs kind = "{kind}" (got kind = "{self.kind}")')
        return self

    @model_validator(mode="after")
    def _one_amount(self) -> Self:
        """Accept one field that sets the amount of gas, and one that sets its flow."""
        for several in (MUCH, FAST):
            given = [field for field in several if getattr(self, field) not in (None, 0.0, [])]
            if len(given) > 1:
                raise ValueError(f"{given[1]}: gives the same quantity as {given[0]}; expected only one of them")
        return self

    @model_validator(mode="after")
    def _curve_rises(self) -> Self:
        pressures = [pressure for pressure, _ in self.pump_curve]
        if any(later <= earlier for earlier, later in itertools.pairwise(pressures)):
            raise ValueError(f"pump_curve: pressures must increase (got {pressures})")
        return self

    @model_validator(mode="after")
    def _times_increase(self) -> Self:
        times = [time for time, _ in self.keyframes]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"{self.keyframed}: keyframe times must increase (got {times})")
        return self


AUTO_SECONDS = 1.0
"""Time in which an automatic pressure rises [s]"""
MUCH = ("amount", "breaths", "litres", "moles", "fill_to_pressure", "fill_to_diameter")
"""Fields that set the amount of gas"""
BLOWN = ("breaths", "litres", "moles")
"""Fields that set an amount blown in at a constant rate"""
FAST = ("pump", "pump_curve", *BLOWN)
"""Fields that set the flow of gas"""
FIELDS_OF_KINDS: dict[str, tuple[str, ...]] = {
    "normal_force": ("k_normal",),
    "pressure": ("pressure", "stretch"),
    "gas": (
        *("amount", "start_pressure", "pump", "pump_curve"),
        *("breaths", "litres", "moles", "fill_time", "fill_to_pressure", "fill_to_diameter"),
        *("gamma", "breathing_damping", "molar_mass", "added_mass", "leak", "water_evened"),
    ),
}
KEYFRAMED_FIELDS: dict[str, Literal["k_normal", "pressure", "pump"]] = {
    "normal_force": "k_normal",
    "pressure": "pressure",
    "gas": "pump",
}


class Neck(Table):
    """Neck of a gas balloon that is let go: gas leaves through the open neck in a jet, which drives the balloon."""

    at: Index | Annotated[str, Field(min_length=1)] = "lowest"
    """Place of the neck: the "lowest" or "highest" place along the up axis at the start, a vertex by the order of the
    file's, or the faces of a group of the mesh, by its name. The jet leaves along the outward normal there"""
    diameter: float = field_of("neck_diameter")
    """Diameter of the opening, however far the rubber around it is stretched; 0 is closed [m]; 0.01 when missing"""
    discharge: float = field_of("neck_discharge")
    """Discharge coefficient, the fraction of the opening that the stream fills: 0.95 to 1 for a smoothly narrowing
    neck, 0.61 for a sharp-edged hole [1]; 1.0 when missing"""
    opens: float = field_of("neck_opens")
    """Time at which the neck opens [s]; 0.0 when missing"""
    closes: float | None = optional_field_of("neck_closes")
    """Time at which the neck closes; never when missing [s]"""

    @model_validator(mode="after")
    def _closes_later(self) -> Self:
        if self.closes is not None and self.closes < self.opens:
            raise ValueError(f"closes: must not come before it opens, at {self.opens:g} s (got {self.closes:g} s)")
        return self


Kind = Literal["springs", "neo_hookean", "mooney_rivlin", "ogden", "gent"]
SpringsBeside = Literal["structural", "shear", "flexion"]
Exponent = Annotated[float, Field(ge=OGDEN_EXPONENTS.least, le=OGDEN_EXPONENTS.most)]
SOFTENING_PARAMETERS = ("softening", "softening_energy", "softening_share")
TEARING_PARAMETERS = ("strength", "tear_strength", "branching_stress", "tear_speed", "needle_time")
OF_ALL = (
    "rest_mesh",
    "thickness",
    "density",
    "wrinkling",
    "most_stretch",
    "viscosity",
    "springs",
    "weights",
    *SOFTENING_PARAMETERS,
    *TEARING_PARAMETERS,
)
MATERIAL_FIELDS: dict[str, tuple[str, ...]] = {
    "springs": ("rest_mesh",),
    "neo_hookean": (*OF_ALL, "shear_modulus", "strain_bound", "exact"),
    "mooney_rivlin": (*OF_ALL, "shear_modulus", "mooney_ratio"),
    "ogden": (*OF_ALL, "ogden_moduli", "ogden_exponents"),
    "gent": (*OF_ALL, "shear_modulus", "gent_limit"),
}
NEARLY_LOCKED = 0.96
"""Default of `most_stretch` for a Gent material, as a fraction of its locking stretch. The law is clamped and the step
computed there: it is 1 / (1 - 0.96^2) = 13 times as stiff against a change of shape as at rest"""


def material_named(name: str) -> dict[str, str]:
    """Return the table of the material of a name: of a kind, or else a preset."""
    return {"kind" if name in MATERIAL_FIELDS else "preset": name}


class Material(Table):
    """Material of the balloon: springs, as in the paper, or rubber or film with a thickness.

    Rubber and film are incompressible: stretched, they become thinner. Mass follows from area, thickness and density,
    so that nothing depends on the mesh. Springs are added only where `springs` lists them.
    """

    preset: Literal["latex", "latex_thick", "natural_rubber_treloar", "foil", "nylon"] | None = None
    """Known material, which supplies the fields that are left out; see RUBBER.md"""
    kind: Kind | None = None
    """Constitutive law; when missing, the preset's, or "springs" """
    shear_modulus: float | None = optional_field_of("shear_modulus")
    """Shear modulus at rest, a third of Young's modulus; 3.3e5 when missing [Pa]"""
    rest_mesh: Path | None = None
    """Mesh file of the stress-free shape, with the same vertices and faces, sought beside the scene file, such as the
    mould of a latex balloon; of a membrane also the same faces cut along seams, the panels that it is sewn of; when
    missing, the shape at the start"""
    thickness: float | None = optional_field_of("thickness")
    """Thickness at rest; 2e-4 when missing [m]"""
    density: Positive | None = None
    """Density of the material [kg/m^3]; 940 when missing"""
    mooney_ratio: float | None = optional_field_of("mooney_ratio")
    """Ratio C2 / C1 of "mooney_rivlin"; 0.1 when missing [1]"""
    ogden_moduli: Vector | None = None
    """Moduli mu of the three terms of "ogden" [Pa]; the shear modulus is half the sum of mu alpha"""
    ogden_exponents: tuple[Exponent, Exponent, Exponent] | None = None
    """Exponents alpha of the three terms of "ogden" """
    gent_limit: float | None = optional_field_of("gent_limit")
    """Limit of I1 - 3 in "gent", where I1 is the sum of the three squared stretches; 97.2 when missing [1]"""
    wrinkling: bool = True
    """Model wrinkling: no resistance to compression, as in a tension field. Otherwise compression is resisted like
    tension"""
    most_stretch: float | None = optional_field_of("most_stretch")
    """Largest equibiaxial stretch for which the step of "auto" is stable and "gent" holds; 6 when missing, or 0.96 of
    the locking stretch of "gent" [1]"""
    strain_bound: Annotated[float, Field(gt=0.0, le=0.1)] | None = None
    """Mean strain of film at the largest planned pressure, or `fill_to_pressure` of a gas: its modulus is no higher
    than this asks for, so that steps are longer, see FOIL.md; when missing 0.003 for the own modulus of "foil" and
    "nylon" [1]"""
    exact: bool = False
    """Keep the preset's own modulus, without its `strain_bound`"""
    viscosity: NonNegative = 0.0
    """Viscosity of the material, which damps any change of its shape [Pa s]"""
    softening: Annotated[float, Field(ge=0.0, le=0.95)] | None = None
    """Hysteresis of rubber (Mullins effect): the largest fraction of the stress that is lost after a greater stretch,
    so that a deflating balloon has less pressure than an inflating one; 1 / r of Ogden and Roxburgh"""
    softening_energy: Positive = 1.0e5
    """Energy density below the greatest one so far at which most of the `softening` has happened [Pa]; m of Ogden and
    Roxburgh"""
    softening_share: Annotated[float, Field(ge=0.0, le=10.0)] = 0.3
    """Fraction of the greatest energy density so far that is added to `softening_energy`; the greater, the more gradual
    the `softening`, and the longer the stable step"""
    strength: Positive | None = None
    """True stress at which the skin tears and the balloon bursts, force over the current cross section [Pa]; never when
    missing"""
    tear_strength: Positive | None = None
    """Stress ahead of a tear's tip that the tear needs to advance, with `strength` [Pa]; 0.3 of `strength` when
    missing"""
    branching_stress: Positive | None = None
    """Stress above which a bursting balloon breaks into pieces instead of opening along one tear, with `strength` [Pa];
    half of `strength` when missing"""
    tear_speed: Positive | None = None
    """Speed of a tear, measured on the unstretched skin, with `strength` [m/s]; when missing, the speed of waves on the
    skin"""
    needle_time: NonNegative = NEVER
    """Time at which a needle pierces the skin where its stretch is greatest, with `strength` [s]; 1e9, never, when
    missing"""
    springs: list[SpringsBeside] = []
    """Kinds of springs in addition to the membrane, such as "flexion" against bending; with a `strength` they must only
    push, `stiffness.yield_stretch = 1`"""
    weights: list[Positive] | dict[str, Positive] | Rule | None = None
    """Factor on the thickness for each vertex of the file, or for groups of the mesh by their names, 1 elsewhere, as
    for a neck. In Python also a function from the mesh's own points, shape (n, 3), to one factor each, shape (n,)"""

    @model_validator(mode="before")
    @classmethod
    def _preset_or_kind(cls, given: Any) -> Any:
        kind = given.get("kind") if isinstance(given, dict) else None
        if isinstance(kind, str) and kind in PRESETS:
            raise ValueError(f'kind: "{kind}" is a preset; expected preset = "{kind}"')
        preset = given.get("preset") if isinstance(given, dict) else None
        if isinstance(preset, str) and preset in MATERIAL_FIELDS:
            raise ValueError(f'preset: "{preset}" is a kind; expected kind = "{preset}"')
        return given

    @property
    def law(self) -> Kind:
        """Constitutive law of the material, or that of its preset."""
        return self.kind or (PRESETS[self.preset]["kind"] if self.preset else "springs")

    @property
    def is_membrane(self) -> bool:
        """Return whether the material is a membrane, not springs."""
        return self.law != "springs"

    @property
    def own_fields(self) -> tuple[str, ...]:
        """Names of the fields that the kind of material has, without those of effects that are off."""
        absent = (
            *(SOFTENING_PARAMETERS if self.softening is None else ()),
            *(TEARING_PARAMETERS if self.strength is None else ()),
        )
        return tuple(field for field in MATERIAL_FIELDS[self.law] if field not in absent)

    def value(self, field: str) -> Any:
        """Return a field's value: the given one, or the preset's; None where neither has it."""
        said = getattr(self, field)
        if said is None and self.preset:
            said = PRESETS[self.preset].get(field)
        if said is None and field == "most_stretch" and (lock := self.locking_stretch) < FAR:
            return max(NEARLY_LOCKED * lock, 1.0)
        return said

    @property
    def bound_on_strain(self) -> float | None:
        """Strain by which film of a lower modulus may stretch [1]; None where the modulus stays as it is.

        A preset's is for its own modulus: one that is given stays.
        """
        if self.exact or self.law != "neo_hookean" or self.shear_modulus is not None:
            return self.strain_bound
        return self.value("strain_bound")

    @property
    def locking_stretch(self) -> float:
        """Equibiaxial stretch at which a Gent material locks."""
        limit = self.value("gent_limit") or GENT_LIMIT.default
        return FAR if self.law != "gent" else (0.5 * (limit + 3.0)) ** 0.5

    @model_validator(mode="after")
    def _fields_of_its_kind(self) -> Self:
        for field, info in type(self).model_fields.items():
            if field in ("preset", "kind", *MATERIAL_FIELDS[self.law]) or getattr(self, field) == info.default:
                continue
            kinds = " or ".join(f'"{kind}"' for kind, fields in MATERIAL_FIELDS.items() if field in fields)
            needed = 'a preset, or a kind such as "neo_hookean"' if field in OF_ALL else f"kind = {kinds}"
            raise ValueError(f'{field}: needs {needed} (got kind = "{self.law}")')
        for (first, *others), what in (
            (SOFTENING_PARAMETERS, "the largest loss of tension"),
            (TEARING_PARAMETERS, "the stress at which it tears"),
        ):
            for field in others:
                if getattr(self, first) is None and getattr(self, field) != type(self).model_fields[field].default:
                    raise ValueError(f"{field}: needs `{first}`, {what}")
        return self

    @model_validator(mode="after")
    def _exact_or_bounded(self) -> Self:
        if self.exact and self.strain_bound is not None:
            raise ValueError(f"exact: is true beside strain_bound = {self.strain_bound:g}; expected one of them")
        return self

    @model_validator(mode="after")
    def _stable(self) -> Self:
        if self.law == "ogden":
            moduli, exponents = self.value("ogden_moduli"), self.value("ogden_exponents")
            if moduli is None or exponents is None:
                missing = "ogden_exponents" if exponents is None else "ogden_moduli"
                raise ValueError(f'{missing}: is missing; kind = "ogden" needs it, or a preset that has it')
            products = [mu * alpha for mu, alpha in zip(moduli, exponents, strict=True)]
            if min(products) < 0.0 or sum(products) <= 0.0:
                raise ValueError(
                    f"ogden_moduli: {list(moduli)} with exponents {list(exponents)} make an unstable material; "
                    "expected modulus times exponent to be at least 0 for each, and above 0 for one"
                )
        if self.most_stretch is not None and self.most_stretch >= self.locking_stretch:
            raise ValueError(
                f"most_stretch: {self.most_stretch:g} exceeds the locking stretch of this material, "
                f"{self.locking_stretch:.3g}; expected less, or a larger gent_limit"
            )
        return self


class Touch(Table):
    """Contact between surfaces of balloons; without this table balloons touch as its defaults say."""

    balloons: bool = True
    """Balloons touch each other"""
    itself: bool | Literal["auto", "soft"] = "auto"
    """Parts of a balloon touch each other, with "soft" so softly that the step of a balloon alone is hardly shorter;
    "auto" is true where parts of a mesh face each other across a gap that inflation may close, and for foil, which
    bends freely and is flat or folded at the start, and "soft" where a closed mesh is so slender that it may bend into
    itself, or starts under water or with a pressure below the air's"""
    edges: bool | Literal["auto"] = "auto"
    """Edges of balloons touch edges, so that no fold crosses another; "auto" takes those that are sharp at the start,
    all edges of balloons that bend freely and are folded, flat or open then, and all where balloons touch themselves"""
    spheres: bool = True
    """Small spheres touch faces, not only particles, so that none passes through, however small and fast"""
    thickness: float | None = optional_field_of("touch_thickness")
    """Distance at which surfaces begin to push; a twentieth of their meshes' edges when missing [m]"""
    stiffness: float | None = optional_field_of("touch_stiffness")
    """Contact stiffness of each particle; a quarter of the sum of a particle's springs when missing [N/m]"""
    friction: float = field_of("touch_friction")
    """Coulomb friction coefficient between balloons that have none of their own [1]; 0.3 when missing"""

    @model_validator(mode="after")
    def _something_touches(self) -> Self:
        if not self.balloons and not self.itself and not self.spheres:
            raise ValueError(
                "balloons: expected true for balloons, itself or spheres (got none); touch = false turns all contact "
                "off"
            )
        return self


def _named(given: Any) -> Any:
    """Return the table of a material that is a name; all else as it is."""
    return material_named(given) if isinstance(given, str) else given


class Stiffness(Table):
    """Spring constants k [N/m] of the three kinds of springs (paper, figure 3)."""

    structural: float = field_of("structural")
    """Spring constant k along the edges of faces [N/m]; 20.0 when missing"""
    shear: float = field_of("shear")
    """Spring constant k across faces [N/m]; 10.0 when missing"""
    flexion: float = field_of("flexion")
    """Spring constant k past one particle, against bending [N/m]; 2.0 when missing"""
    torsion: float = field_of("torsion")
    """Torsional stiffness of each edge between two faces, against a change of the dihedral angle [N m/rad]; 0.0 when
    missing"""
    variation: UnitInterval = 0.0
    """Random scatter of spring constants: each is drawn uniformly from k (1 - variation) to k (1 + variation)"""
    seed: Index = 0
    """Seed of the random spring constants"""
    gradient: tuple[NonNegative, NonNegative] = (1.0, 1.0)
    """Factors on the spring constants at the balloon's lowest and highest coordinate, linear between them"""
    gradient_axis: Literal["X", "Y", "Z"] = "Y"
    """Axis of the scene along which `gradient` acts, by the midpoint of each spring at the start"""
    weights: list[NonNegative] | dict[str, NonNegative] | Rule | None = None
    """Factor on the spring constants for each vertex of the file, or for groups of the mesh by their names, 1
    elsewhere; a spring takes the mean of its two ends. In Python also a function from the mesh's own points, shape (n,
    3), to one factor each, shape (n,)"""
    viscosity: float = field_of("viscosity")
    """Damping constant along a spring over its spring constant (Tarantino 1996) [s]; 0.0 when missing"""
    yield_stretch: float | None = optional_field_of("yield_stretch")
    """Length over rest length above which the spring force stays constant (Tarantino 1996) [1]"""
    even: bool = False
    """Weigh each spring by the area beside it, so that stiffness is uniform and isotropic on any mesh, and distribute
    mass in proportion to stiffness, which allows a long step. Otherwise each spring has the constant of its kind and
    each particle the same mass"""
    thin: Literal["alike", "softer", "tied"] = "alike"
    """Treatment of thin parts. "alike": the same spring constants everywhere; pressure stretches a thin part less, in
    proportion to its thickness. "softer": smaller constants in thin parts; all parts stretch nearly alike. "tied":
    springs across thin parts, from wall to wall; legs bear load and thin walls do not swell into pillows"""


def _mesh_of(given: Any) -> Any:
    """Convert a mesh-like Python value to a mesh.

    File names and values of other types pass unchanged.
    """
    return mesh_from(given) if is_mesh(given) else given


class Balloon(Table):
    """A mesh that becomes a balloon."""

    mesh: Annotated[Path | InstanceOf[PolygonMesh], BeforeValidator(_mesh_of)]
    """Mesh file, sought beside the scene file. In Python also a PolygonMesh, a trimesh.Trimesh, or points and faces"""
    prim: Prim | None = None
    """Object of the mesh file, or a list of several: in a USD stage the path of a prim, such as "/Room/Wall0", or of
    what it stands in; in an OBJ file an object or a group, in a glTF file a node or a mesh, by name. When missing, all
    that the file shows: of a stage, what is visible and of purpose "default" or "render" """
    weld: bool | Literal["auto"] | Annotated[float, Field(ge=LEAST_GAP, le=LARGEST_GAP)] = "auto"
    """Weld seams, where open edges meet from end to end. "auto": within a millionth of the mesh's size; a number:
    within that fraction of it; true: wherever vertices coincide exactly; false: nowhere"""
    holes: Holes = "cap"
    """Close holes in the mesh's surface, such as pinholes and eye sockets, or "keep" them. Openings such as the rim of
    a bowl or a sleeve always stay"""
    parts: Parts = "held"
    """Tie parts of the mesh that share no vertex together by structural springs, or leave them "free"; `taken` chooses
    parts"""
    taken: Taken = "all"
    """Parts of the mesh that make up the balloon: "all", the "closed" ones, without loose ribbons such as hair, or the
    "largest" by area; --parts of commands"""
    unit: Unit | None = None
    """Unit of the mesh's coordinates; when missing, the unit in the mesh file, else the meter"""
    name: str = ""
    """Name of the prim in the stage; the mesh's name when empty"""
    position: Vector = (0.0, 0.0, 0.0)
    """Position of the mesh's origin [m]"""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Rotation about x, then y, then z, applied before `position` [degrees]"""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity of the whole balloon at the start [m/s]"""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """Angular velocity at the start about the center of mass, along the axes of the scene [rad/s]"""
    up: UpAxis | None = None
    """Up axis of the mesh file; when missing, the one in the file, else "Y". The mesh is turned so that this axis
    points up in the scene"""
    scale: Positive = 1.0
    """Factor on the mesh's size, applied before `rotation`"""
    mass: float = field_of("mass")
    """Mass of the whole balloon, shared equally by its particles [kg]; 0.1 when missing"""
    helium: float = field_of("helium")
    """Buoyant acceleration; above `gravity` the balloon rises [m/s^2]; 0.0 when missing"""
    damping: float = field_of("damping")
    """Linear drag coefficient of the whole balloon, distributed like the mass [N s/m]; 0.1 when missing"""
    drag_coefficient: float = field_of("drag_coefficient")
    """Drag coefficient C_d of 1/2 density C_d A u^2, as for a sphere, at airspeed u [1]; 0.0 when missing"""
    face_drag: float = field_of("face_drag")
    """Normal coefficient C_n of each face in the air: 1/2 density C_n A |u| u_n against the part of u along the face's
    normal; it gives lift and drag [1]; 0.0 when missing"""
    face_friction: float = field_of("face_friction")
    """Tangential coefficient C_t of the air's force along each face, with C_t in place of C_n [1]; 0.0 when missing"""
    friction: float | None = optional_field_of("balloon_friction")
    """Coulomb friction coefficient; a contact takes the geometric mean of both. When missing, the other thing's
    coefficient counts alone, and between balloons `touch.friction` [1]"""
    stiffness: Stiffness = Stiffness()
    """Spring constants k [N/m] of the three kinds of springs (paper, figure 3)."""
    springs: Path | None = None
    """File of springs (.npz), sought beside the scene file, in place of the mesh's own springs: `pairs` of particles,
    shape (m, 2); `rest_lengths` in the mesh's unit; and `constants` [N/m], which a later change of `stiffness`
    multiplies"""
    material: Annotated[Material, BeforeValidator(_named)] = Material()
    """Material of the balloon: springs, as in the paper, or rubber or film with a thickness."""
    inflation: Inflation = Inflation()
    """Inflation of a balloon: a pressure, a sealed gas, or the paper's normal forces."""
    neck: Neck | None = None
    """The neck of a balloon with gas that is let go: open, gas leaves through it in a jet, which drives the balloon."""
    fixed: Annotated[list[Index | Annotated[str, Field(min_length=1)]], BeforeValidator(pins_of)] = []
    """Particles that do not move: vertices of the file, counted from 0, or all of a group of the mesh, by its name (`g`
    and `o` of an OBJ file, subsets of USD). In Python also a mask, or a function from the mesh's own points, shape (n,
    3), to a mask, shape (n,)"""
    color: Color | None = None
    """Linear RGB, or a color of the web, "red" or "#ff8000"; when missing, the colors or images of the mesh file, else
    a color of the palette"""
    look: Literal["latex", "foil"] | None = None
    """Appearance: translucent latex, or foil, which mirrors. When missing, latex, but foil where the material's preset
    is foil or nylon, and an opaque skin where the color is the mesh's own"""
    print: Path | None = None
    """Image file, such as a .png, sought beside the scene file, printed on the balloon in place of its color by the
    mesh's texture coordinates"""
    law: LawTables = {}
    """Balloon parameters of user-defined laws, by law and name"""

    @property
    def looks_like(self) -> Literal["latex", "foil"]:
        """Look of the balloon, or that of its material."""
        return self.look or ("foil" if self.material.preset in ("foil", "nylon") else "latex")

    @property
    def treatment(self) -> Treatment:
        """Treatment of the mesh's seams, holes and parts."""
        return Treatment(self.weld, self.holes, self.parts, self.taken)

    @model_validator(mode="after")
    def _one_mass(self) -> Self:
        if self.material.is_membrane and self.mass != type(self).model_fields["mass"].default:
            raise ValueError(
                f"mass: follows from the material's thickness and density (got {self.mass:g}); expected none, or "
                'material.kind = "springs"'
            )
        return self

    @model_validator(mode="after")
    def _neck_of_gas(self) -> Self:
        if self.neck and self.inflation.kind != "gas":
            raise ValueError(f'neck: needs inflation.kind = "gas" (got "{self.inflation.kind}")')
        return self

    @model_validator(mode="before")
    @classmethod
    def _parts_or_taken(cls, given: Any) -> Any:
        for field, other, words in (("parts", "taken", get_args(Taken)), ("taken", "parts", get_args(Parts))):
            found = given.get(field) if isinstance(given, dict) else None
            if isinstance(found, str) and found in words:
                raise ValueError(f'{field}: "{found}" is a value of {other}; expected {other} = "{found}"')
        return given

    @model_validator(mode="before")
    @classmethod
    def _without_rules(cls, given: Any) -> Any:
        """Evaluate functions of points, so that a scene can be written down."""
        if not isinstance(given, dict) or "mesh" not in given:
            return given
        for field in ("fixed", "stiffness.weights", "material.weights"):
            table, _, of_table = field.partition(".")
            holder = given.get(table) if of_table else given
            rule = value_in(holder, of_table or table)
            if not callable(rule):
                continue
            try:
                points = load_mesh(given["mesh"], given.get("prim")).points
                if of_table:
                    given = {**given, table: with_value(holder, of_table, weighed_by(rule, points))}
                else:
                    given = {**given, table: pinned_by(rule, points)}
            except InputError as mistake:
                raise ValueError(f"{field}: {mistake}") from None
        return given


def value_in(given: Any, name: str) -> Any:
    """Return a field of a table, or of an object."""
    return given.get(name) if isinstance(given, dict) else getattr(given, name, None)


def with_value(given: Any, name: str, value: Any) -> dict[str, Any]:
    """Return the same as a table with another value of a field, which is checked like the others."""
    table = given if isinstance(given, dict) else {field: getattr(given, field) for field in given.model_fields_set}
    return {**table, name: value}
