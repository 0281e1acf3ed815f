"""Inflation of balloons, and the neck through which gas escapes."""

import itertools
import math
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ModelWrapValidatorHandler, model_validator

from balloon_warp.scene.schema.fields import (
    Index,
    Keyframe,
    Keyframed,
    NonNegative,
    Real,
    Table,
    UnitInterval,
    field_of,
    optional_field_of,
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
