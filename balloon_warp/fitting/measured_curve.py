"""A measured curve of a rubber: a load over a size."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.fitting.quantities import Test

Values = NDArray[np.float64]
QUANTITIES = {True: ("volume", "pressure", " m^3"), False: ("stretch", "nominal stress", "")}
"""Names, of an inflation and of another test, of sizes and loads, and the unit of sizes"""
TESTS: dict[Test, str] = {
    "inflation": "an inflation",
    "uniaxial": "a uniaxial test",
    "equibiaxial": "an equibiaxial test",
    "planar": "a planar test",
}


@dataclass(frozen=True)
class Curve:
    """A measured curve: an inflation, or the stretching of a strip or sheet."""

    sizes: Values
    """Volumes [m^3] or stretches [1], shape (n,)"""
    loads: Values
    """Gauge pressures, or stresses over the area at rest [Pa], shape (n,)"""
    test: Test = "inflation"
    size_deviations: Values | None = None
    """Standard deviations of the sizes, where they are known, shape (n,)"""
    load_deviations: Values | None = None
    """Standard deviations of the loads, where they are known, shape (n,)"""
    remarks: tuple[str, ...] = ()
    """Sentences on the choices made in reading the file"""
    name: str = "the curve"
    """Name in sentences"""
    of_sphere: bool = False
    """Whether volumes follow from a diameter"""

    @property
    def load_name(self) -> str:
        """Name of the loads."""
        return "pressure" if self.test == "inflation" else "stress"

    @property
    def summary(self) -> str:
        """Description of the curve and its ranges, in words."""
        size, load, unit = QUANTITIES[self.test == "inflation"]
        known = ", ".join(
            f"deviations of {name}"
            for name, deviations in ((size, self.size_deviations), (load, self.load_deviations))
            if deviations is not None
        )
        return (
            f"{self.name}: {len(self.sizes)} rows of {TESTS[self.test]}: {size} {self.sizes.min():.4g} to "
            f"{self.sizes.max():.4g}{unit}, {load} {self.loads.min():.4g} to {self.loads.max():.4g} Pa"
            f"{known and f', {known}'}"
        )
