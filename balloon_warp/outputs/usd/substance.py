"""Physics material of a balloon: the surface deformable's of the AOUSD physics group's proposal."""

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray
from pxr import Sdf, Usd

from balloon_warp.model.materials import law_of
from balloon_warp.model.model import Model
from balloon_warp.model.skin import INCOMPRESSIBLE, sheet_of_springs, youngs_modulus
from balloon_warp.outputs.usd.rigid import substance_of

SCHEMA = "PhysicsSurfaceDeformableMaterialAPI"


def bind_substance(prim: Usd.Prim, model: Model, number: int) -> None:
    """Give a balloon's prim a physics material of its own.

    It has rubber's and film's moduli and density, or those of the sheet that springs make, and the balloon's friction.
    """
    parameters = {name: values.numpy() for name, values in model.parameters.items()}
    substance, surface = substance_of(prim)
    substance.AddAppliedSchema(SCHEMA)
    if law_of(model.scene, number):
        surface.CreateDensityAttr(float(parameters["initial_density"][0, number]))
    if (friction := model.scene.balloon[number].friction) is not None:
        surface.CreateStaticFrictionAttr(friction)
        surface.CreateDynamicFrictionAttr(friction)
    for name, value in _moduli(model, parameters, number).items():
        substance.CreateAttribute(f"physics:{name}", Sdf.ValueTypeNames.Float, custom=False).Set(value)


def _moduli(model: Model, parameters: Mapping[str, NDArray[Any]], number: int) -> dict[str, float]:
    """Return the moduli by their names in the proposal, in SI, which is the stage's unit system."""
    if law := law_of(model.scene, number):
        return {"youngsModulus": youngs_modulus(law, parameters, number), "poissonsRatio": INCOMPRESSIBLE}
    sheet = sheet_of_springs(model.shapes[number], parameters, number)
    return {f"surface{name.title()}Stiffness": value for name, value in sheet._asdict().items()} if sheet else {}
