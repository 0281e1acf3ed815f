"""A scene with its balloons made of another material, or of another color."""

from balloon_warp.scene import Balloon, Inflation, Material, Scene, Stiffness

MATERIALS = ("springs", "latex", "foil", "nylon")
"""Materials in the page's menu"""
FILMS = {"foil": 5.0, "nylon": 3.0}
"""Films, simulated as springs of a multiple of the stiffness, which bend freely: where no pressure is planned, real
film takes thousands of substeps a frame"""
FILM_STRETCH = 0.05
"""Stretch of an inflated film's skin"""


def material_of(scene: Scene) -> str:
    """Return the name of the first balloon's material."""
    balloon = scene.balloon[0]
    return balloon.material.preset or (balloon.look == "foil" and "foil") or balloon.material.law


def made_of(scene: Scene, name: str) -> Scene:
    """Return the scene with all balloons of another material.

    A gas stays; other inflations become the usual pressure of that material: a pressure that springs bear is too low
    for foil.

    Raises:
        InputError: it cannot be simulated so.
    """
    if name == material_of(scene):
        return scene
    said = {field: getattr(scene, field) for field in scene.model_fields_set}
    return Scene.model_validate(said | {"balloon": [_made_of(each, name) for each in scene.balloon], "change": []})


def _made_of(balloon: Balloon, name: str) -> Balloon:
    kept = {field: getattr(balloon, field) for field in balloon.model_fields_set - {"material", "look"}}
    if balloon.inflation.kind != "gas":
        kept["inflation"] = Inflation(stretch=FILM_STRETCH) if name in FILMS else Inflation()
    if name == "latex":
        for field in ("mass", "stiffness"):  # follow from its thickness
            kept.pop(field, None)
        return Balloon(**kept, material=Material(preset="latex"))
    if name in FILMS:
        kept["stiffness"] = _stiffer(balloon.stiffness, FILMS[name])
        kept["look"] = "foil"
    return Balloon(**kept)


def _stiffer(stiffness: Stiffness, factor: float) -> Stiffness:
    springs = {"structural": factor * stiffness.structural, "shear": factor * stiffness.shear, "flexion": 0.0}
    return stiffness.model_copy(update=springs)


def painted(scene: Scene, color: tuple[float, float, float]) -> Scene:
    """Return the scene with all balloons of a color, in linear RGB."""
    balloons = [balloon.model_copy(update={"color": color}) for balloon in scene.balloon]
    return scene.model_copy(update={"balloon": balloons})
