"""Material of a balloon."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from balloon_warp.kernels.laws.law import FAR
from balloon_warp.kernels.laws.membrane import GENT_LIMIT, OGDEN_EXPONENTS
from balloon_warp.kernels.laws.tearing import NEVER
from balloon_warp.scene.presets import PRESETS
from balloon_warp.scene.schema.fields import NonNegative, Positive, Rule, Table, Vector, optional_field_of

Kind = Literal["springs", "neo_hookean", "mooney_rivlin", "ogden", "gent"]
SpringsBeside = Literal["structural", "shear", "flexion"]
Exponent = Annotated[float, Field(ge=OGDEN_EXPONENTS.least, le=OGDEN_EXPONENTS.most)]
SOFTENING = ("softening", "softening_energy", "softening_share")
TEARING = ("strength", "tear_strength", "branching_stress", "tear_speed", "needle_time")
OF_ALL = (
    "rest_mesh",
    "thickness",
    "density",
    "wrinkling",
    "most_stretch",
    "viscosity",
    "springs",
    "weights",
    *SOFTENING,
    *TEARING,
)
FIELDS_OF_KINDS: dict[str, tuple[str, ...]] = {
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
    return {"kind" if name in FIELDS_OF_KINDS else "preset": name}


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
        if isinstance(preset, str) and preset in FIELDS_OF_KINDS:
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
        absent = (*(SOFTENING if self.softening is None else ()), *(TEARING if self.strength is None else ()))
        return tuple(field for field in FIELDS_OF_KINDS[self.law] if field not in absent)

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
            if field in ("preset", "kind", *FIELDS_OF_KINDS[self.law]) or getattr(self, field) == info.default:
                continue
            kinds = " or ".join(f'"{kind}"' for kind, fields in FIELDS_OF_KINDS.items() if field in fields)
            needed = 'a preset, or a kind such as "neo_hookean"' if field in OF_ALL else f"kind = {kinds}"
            raise ValueError(f'{field}: needs {needed} (got kind = "{self.law}")')
        for (first, *others), what in (
            (SOFTENING, "the largest loss of tension"),
            (TEARING, "the stress at which it tears"),
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
