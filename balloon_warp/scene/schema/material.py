"""What a balloon is made of."""

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
    "neo_hookean": (*OF_ALL, "shear_modulus"),
    "mooney_rivlin": (*OF_ALL, "shear_modulus", "mooney_ratio"),
    "ogden": (*OF_ALL, "ogden_moduli", "ogden_exponents"),
    "gent": (*OF_ALL, "shear_modulus", "gent_limit"),
}
NEARLY_LOCKED = 0.96
"""of the stretch at which a Gent material locks is the most that the law holds to, and the step is made for, where
nobody says it: 1 / (1 - 0.96^2) = 13 times as stiff as at rest against what changes the shape"""


class Material(Table):
    """What the balloon is made of: springs, as in the paper, or rubber or film that has a thickness.

    Rubber and film are incompressible: stretched, they become thinner. Mass follows from area, thickness and density,
    so that nothing depends on the mesh. They have no springs but those that are asked for.
    """

    preset: Literal["latex", "latex_thick", "natural_rubber_treloar", "foil", "nylon"] | None = None
    """a material that is known: the fields that are left out are its own, see RUBBER.md"""
    kind: Kind | None = None
    """the law of its stretching; when missing, the preset's, or "springs\""""
    shear_modulus: float | None = optional_field_of("shear_modulus")
    """at rest; a third of Young's; 3.3e5 when missing [Pa]"""
    rest_mesh: Path | None = None
    """a mesh file, sought beside the scene file, of the same vertices and faces: the shape at which nothing pulls, such
    as the mould of a latex balloon; or, of a film, of the same faces cut along seams: the panels that it is sewn of;
    when missing, that of the start"""
    thickness: float | None = optional_field_of("thickness")
    """at rest; 2e-4 when missing [m]"""
    density: Positive | None = None
    """of the material [kg/m^3]; 940 when missing"""
    mooney_ratio: float | None = optional_field_of("mooney_ratio")
    """of "mooney_rivlin": C2 over C1; 0.1 when missing [1]"""
    ogden_moduli: Vector | None = None
    """of "ogden": mu of each of its three terms [Pa]; the shear modulus is half the sum of mu alpha"""
    ogden_exponents: tuple[Exponent, Exponent, Exponent] | None = None
    """of "ogden": alpha of each"""
    gent_limit: float | None = optional_field_of("gent_limit")
    """of "gent": what I1 - 3 cannot exceed, I1 the sum of the three squared stretches; 97.2 when missing [1]"""
    wrinkling: bool = True
    """it gives way to compression, as what is thin does; else it resists that as it resists tension"""
    most_stretch: float | None = optional_field_of("most_stretch")
    """up to which, both ways, the step of "auto" is stable and "gent" holds; 6 when missing, or 0.96 of what "gent"
    allows [1]"""
    viscosity: NonNegative = 0.0
    """damping of the material's own, against any change of its shape [Pa s]"""
    softening: Annotated[float, Field(ge=0.0, le=0.95)] | None = None
    """rubber's hysteresis (Mullins): the largest part of its pull that it loses once it has been stretched further, so
    that a balloon has less pressure as it deflates than as it was inflated; Ogden and Roxburgh's 1 / r"""
    softening_energy: Positive = 1.0e5
    """of `softening`: when the energy density is so far below the greatest that there was, most of that part is lost
    [Pa]; their m"""
    softening_share: Annotated[float, Field(ge=0.0, le=10.0)] = 0.3
    """of `softening`: this part of the greatest energy density is added to `softening_energy`; the greater, the slower
    it gives way, and the longer the stable step"""
    strength: Positive | None = None
    """the true stress at which it tears and the balloon bursts, force over what is left of the section [Pa]; when
    missing, it never does"""
    tear_strength: Positive | None = None
    """of `strength`: the stress ahead of the tip of a tear that it needs to run on [Pa]; 0.3 of it when missing"""
    branching_stress: Positive | None = None
    """of `strength`: a balloon that bursts at a higher stress does not open along one tear, but in pieces [Pa]; half of
    it when missing"""
    tear_speed: Positive | None = None
    """of `strength`: how fast a tear runs, measured on the unstretched skin [m/s]; if missing, as fast as waves on its
    surface"""
    needle_time: NonNegative = NEVER
    """of `strength`: when a needle pierces it, where it is stretched most [s]; 1e9, never, when missing"""
    springs: list[SpringsBeside] = []
    """kinds of springs that it has beside, such as "flexion" against bending; beside a `strength` they must only push,
    `stiffness.yield_stretch = 1`"""
    weights: list[Positive] | dict[str, Positive] | Rule | None = None
    """a number for each vertex of the file, or for groups of the mesh by their names, and 1 elsewhere: the thickness is
    multiplied by it, as for a neck. From Python also a function that takes the mesh's own points, shape (n, 3), and
    gives the number of each, shape (n,)"""

    @property
    def law(self) -> Kind:
        """Kind of the material, or that of its preset."""
        return self.kind or (PRESETS[self.preset]["kind"] if self.preset else "springs")

    @property
    def is_membrane(self) -> bool:
        """Whether it is not of springs."""
        return self.law != "springs"

    @property
    def own_fields(self) -> tuple[str, ...]:
        """Fields that its kind has, without what it does not do."""
        absent = (*(SOFTENING if self.softening is None else ()), *(TEARING if self.strength is None else ()))
        return tuple(field for field in FIELDS_OF_KINDS[self.law] if field not in absent)

    def value(self, field: str) -> Any:
        """Return what a field is: as said, or as its preset has it; None where neither says it."""
        said = getattr(self, field)
        if said is None and self.preset:
            said = PRESETS[self.preset].get(field)
        if said is None and field == "most_stretch" and (lock := self.locking_stretch) < FAR:
            return max(NEARLY_LOCKED * lock, 1.0)
        return said

    @property
    def locking_stretch(self) -> float:
        """Stretch both ways at which a Gent material's chains are straight."""
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
        for (first, *others), what in ((SOFTENING, "the most of its pull that it loses"), (TEARING, "where it tears")):
            for field in others:
                if getattr(self, first) is None and getattr(self, field) != type(self).model_fields[field].default:
                    raise ValueError(f"{field}: needs `{first}`, {what}")
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
                    "expected each modulus times its exponent to be at least 0, and one more than that"
                )
        if self.most_stretch is not None and self.most_stretch >= self.locking_stretch:
            raise ValueError(
                f"most_stretch: {self.most_stretch:g} is past the limit of this material, whose chains are straight at "
                f"{self.locking_stretch:.3g}; expected less, or a larger gent_limit"
            )
        return self
