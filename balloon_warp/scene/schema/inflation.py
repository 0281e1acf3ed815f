"""What fills balloons, and how it leaves them."""

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
    """What fills a balloon.

    - "pressure": a given pressure acts on every face. On a closed mesh its forces add up to nothing.
    - "gas": a sealed amount of gas does, whose pressure falls as it expands, and which has weight and buoyancy.
    - "normal_force", the paper's: each particle is pushed by 100 k_normal (A_p / A_total) along its normal [N]. These
      forces do not add up to nothing, and the effect of k_normal depends on how the mesh is divided into faces.
    """

    kind: Literal["pressure", "gas", "normal_force"] = "pressure"
    """if left out, it follows from the fields that are given; without any, a pressure"""
    pressure: Literal["auto"] | Keyframed = "auto"
    """of "pressure": above the air's [Pa]; a number or keyframes; or "auto", which rises within a second to what
    stretches the balloon as `stretch` says, or so, whatever its size, its faces and its springs"""
    stretch: UnitInterval = 0.25
    """of the pressure "auto", and else without effect: how much a ball's skin is stretched; 0.1 makes its volume a
    third larger"""
    k_normal: Keyframed = 0.2
    """of "normal_force"; a number or keyframes"""
    amount: NonNegative | None = None
    """of "gas", at the start [mol]; what `start_pressure` asks for when missing"""
    start_pressure: Real = 0.0
    """of "gas": above the air's, at the start [Pa]; 0 is in balance with springs at their rest lengths"""
    pump: Keyframed = 0.0
    """of "gas": what is pumped in, and if negative let out [mol/s]; a number or keyframes"""
    pump_curve: list[tuple[NonNegative, NonNegative]] = []
    """of "gas": what a pump gives against a pressure, [[pressure, flow], ...], above the air's [Pa] and [mol/s]: linear
    between them, and nothing beyond the last"""
    breaths: float = field_of("fill_breaths")
    """of a gas: deep breaths that are blown in, each of 3.5 l at the pressure of the air, an adult's inspiratory
    capacity [1]; 0.0 when missing"""
    litres: float = field_of("fill_litres")
    """of a gas: litres, at the pressure of the air, that are blown in [l]; 0.0 when missing"""
    moles: float = field_of("fill_moles")
    """of a gas: moles that are blown in [mol]; 0.0 when missing"""
    fill_time: float = field_of("fill_time")
    """of a gas: the time in which breaths, litres or moles are blown in, evenly from the start; with `fill_to_pressure`
    or `fill_to_diameter`, the time of each breath [s]; 1.0 when missing"""
    fill_to_pressure: float = field_of("fill_to_pressure")
    """of a gas: blow until it presses so much more than the air, and no further; 0 is no such end [Pa]; 0.0 when
    missing"""
    fill_to_diameter: float = field_of("fill_to_diameter")
    """of a gas: blow until a ball of its volume would be so wide, and no further; 0 is no such end [m]; 0.0 when
    missing"""
    gamma: float = field_of("gamma")
    """p V^gamma of a sealed gas stays as it is: 1.4 keeps air's heat in, 1.667 helium's; 1 keeps it as warm as the air
    [1]; 1.0 when missing"""
    breathing_damping: float = field_of("breathing_damping")
    """of a gas: how much the step damps a balloon's breathing, its quick swelling and shrinking: 1 as backward Euler
    does; 0 not at all, by the trapezoidal rule, so that balloons breathe on [1]; 1.0 when missing"""
    molar_mass: float = field_of("molar_mass")
    """of a gas [kg/mol]; 0.0040026 when missing"""
    added_mass: float = field_of("added_mass")
    """of a gas's balloon: how much air moves along with it, as a part of the air that it displaces; 0.5 for a sphere, 0
    for none [1]; 0.5 when missing"""
    leak: float = field_of("leak")
    """of a gas: area of a stream that gets out through pores and pinholes, without thrust [m^2]; 0.0 when missing"""

    @property
    def keyframed(self) -> Literal["k_normal", "pressure", "pump"]:
        """Field that its kind may change with time."""
        return KEYFRAMED_FIELDS[self.kind]

    @property
    def own_fields(self) -> tuple[str, ...]:
        """Fields that its kind has."""
        return FIELDS_OF_KINDS[self.kind]

    @property
    def has_keyframes(self) -> bool:
        """Whether the field that may change is given as keyframes."""
        return isinstance(getattr(self, self.keyframed), list)

    @property
    def is_automatic(self) -> bool:
        """Whether its pressure is left to us."""
        return self.kind == "pressure" and self.pressure == "auto"

    @property
    def says_how_much(self) -> bool:
        """Whether it says how much gas there is, or comes."""
        return any(getattr(self, field) not in (None, 0.0, []) for field in (*MUCH, *FAST, "start_pressure"))

    @property
    def keyframes(self) -> list[Keyframe]:
        """That field as keyframes; a plain number is one keyframe, and NaN a pressure that is left to us."""
        if self.is_automatic:
            return [(0.0, 0.0), (AUTO_SECONDS, math.nan)]
        value = getattr(self, self.keyframed)
        return value if isinstance(value, list) else [(0.0, value)]

    @property
    def names_its_kind(self) -> bool:
        """Whether its kind was given; else other fields than it has ask for another one."""
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
        """One way of saying how much, and one of saying how fast."""
        for several in (MUCH, FAST):
            given = [field for field in several if getattr(self, field) not in (None, 0.0, [])]
            if len(given) > 1:
                raise ValueError(f"{given[1]}: says another way what {given[0]} says; expected one of both")
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
"""in which a pressure that is left to us rises"""
MUCH = ("amount", "breaths", "litres", "moles", "fill_to_pressure", "fill_to_diameter")
"""ways of saying how much gas there will be"""
BLOWN = ("breaths", "litres", "moles")
"""ways of saying how much is blown in evenly"""
FAST = ("pump", "pump_curve", *BLOWN)
"""ways of saying how fast it comes"""
FIELDS_OF_KINDS: dict[str, tuple[str, ...]] = {
    "normal_force": ("k_normal",),
    "pressure": ("pressure", "stretch"),
    "gas": (
        *("amount", "start_pressure", "pump", "pump_curve"),
        *("breaths", "litres", "moles", "fill_time", "fill_to_pressure", "fill_to_diameter"),
        *("gamma", "breathing_damping", "molar_mass", "added_mass", "leak"),
    ),
}
KEYFRAMED_FIELDS: dict[str, Literal["k_normal", "pressure", "pump"]] = {
    "normal_force": "k_normal",
    "pressure": "pressure",
    "gas": "pump",
}


class Neck(Table):
    """The neck of a balloon with gas that is let go: open, gas leaves through it in a jet, which drives the balloon."""

    at: Index | Annotated[str, Field(min_length=1)] = "lowest"
    """where it is: the "lowest" or "highest" place along the up axis at the start, a vertex by the order of the file's,
    or the faces of a group of the mesh, by its name; the jet goes straight out from there"""
    diameter: float = field_of("neck_diameter")
    """of the opening, however far the rubber around it is stretched; 0 is closed [m]; 0.01 when missing"""
    discharge: float = field_of("neck_discharge")
    """part of the opening that the stream fills: 0.95 to 1 of a neck that narrows smoothly, 0.61 of a hole with a sharp
    edge [1]; 1.0 when missing"""
    opens: float = field_of("neck_opens")
    """when it is let go [s]; 0.0 when missing"""
    closes: float | None = optional_field_of("neck_closes")
    """when it is shut again; never when missing [s]"""

    @model_validator(mode="after")
    def _closes_later(self) -> Self:
        if self.closes is not None and self.closes < self.opens:
            raise ValueError(f"closes: must not come before it opens, at {self.opens:g} s (got {self.closes:g} s)")
        return self
