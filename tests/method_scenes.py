"""Scenes that have all methods between them: the feature sets, and pairs that these lack; and features in words."""

from functools import cache
from typing import Any

import numpy as np
from feature_sets import SETS, feature_set
from meshes import finned, quad_sphere

from balloon_warp import load_scene
from balloon_warp.benchmarks.matrix import of_phase
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws import LAWS
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.substep import conditional_phases
from balloon_warp.model import Model, build_model
from balloon_warp.scene import Balloon, Body, Inflation, Material, Obstacle, Scene, Sphere, String, Touch
from balloon_warp.scene.load import bundled_scenes, override_scene, parse_override
from balloon_warp.schedules.framing import has_free_frames
from balloon_warp.schedules.tables import model_features

TIED = String(anchor=(0.0, 3.0, 0.0), balloon=1, particle="highest", length=1.5)
MOVES = [(0.0, (0.0, 0.0, 0.0)), (1.0, (0.5, 0.2, 0.0), (0.0, 90.0, 0.0))]


def more(values: dict[str, Any] | None = None, **fields: Any) -> Scene:
    """Return the set of all features apart, with another law of rubber, gas that is blown in, spheres that meet, and
    other values by their paths, in steps that all bear."""
    of = feature_set("all")
    soft = Material(preset="natural_rubber_treloar", softening=0.4, softening_energy=3e4, viscosity=10.0)
    rubber = of.balloon[2].model_copy(update={"material": soft})
    other = Sphere(position=(0.7, -0.4, 0.9), radius=0.25, mass=0.2, velocity=(0.0, 0.0, -2.0), friction=0.2)
    tables: dict[str, Any] = {"balloon": [*of.balloon[:2], rubber], "sphere": [*of.sphere, other], "touch": False}
    told = {"substeps": 64, "balloon.0.inflation.litres": 2.0, "balloon.0.inflation.fill_time": 0.06}
    return load_scene(of.model_copy(update=tables | fields), told | (values or {}))


def with_fin() -> Scene:
    """Return a scene of forward Euler, for so short a time that it gains little energy, with a fin, whose faces pass
    corners twice."""
    of = more({"solver": "forward_euler"}, tube=[])
    fin = Balloon(mesh=finned(2), position=(1.2, 0.0, 0.0), inflation=Inflation(pressure=[(0.0, 5.0), (0.1, 20.0)]))
    return of.model_copy(update={"balloon": [*of.balloon[:2], fin]})


def of_meshes() -> Scene:
    """Return a scene with obstacles and a body that are meshes, balloons that touch themselves, too, a small sphere and
    one that faces meet."""
    of = feature_set("all")
    return more(
        touch=Touch(itself=True), faces=True,
        obstacle=[*of.obstacle, Obstacle(mesh=quad_sphere(3, 0.4), position=(-0.95, 0.2, 0.0), motion=MOVES)],
        body=[Body(mesh=quad_sphere(3, 0.2), position=(1.2, 0.75, 0.1), mass=0.1, angular_velocity=(0.0, 0.0, 3.0))],
        sphere=[
            *of.sphere, Sphere(position=(0.1, 3.0, 0.05), radius=0.004, friction=0.3),
            Sphere(position=(0.15, 2.02, 0.1), radius=0.6, mass=0.3, velocity=(0.0, -1.0, 0.0)),
        ],
    )  # fmt: skip


def bursting() -> Scene:
    """Return a dry scene, with contacts told, and rubber that a needle pierces, whose hole does not grow. It is thinner
    to one side, as rounding would choose the most loaded face of a round ball."""
    of = more({"contacts": True}, water=None, tube=[])
    thinner = (1.0 + 0.6 * of.balloon[2].mesh.points @ (0.31, 0.17, 0.9)).tolist()
    torn = Material(preset="latex", strength=1e9, tear_strength=1e9, needle_time=0.05, weights=thinner)
    pricked = of.balloon[2].model_copy(update={"material": torn})
    return of.model_copy(update={"balloon": [*of.balloon[:2], pricked]})


def with_phase(phase: Phase) -> Scene:
    """Return a set with spheres, with a phase and its parameters."""
    overrides = [each for each in of_phase(phase).overrides if not each.startswith("sphere=")]
    return override_scene(feature_set("paper"), map(parse_override, overrides))


VARIANTS = {
    "more": more(),
    "more by penalty, dry": more({"contact": "penalty", "normals": "cached"}, water=None, obstacle=[], string=[TIED]),
    "more corrected": more({"correction": "tarantino", "correction_limit": 0.01, "correction_sweeps": 2}),
    "more in touch": more({"contact": "penalty"}, touch=Touch(spheres=False)),
    "more by forward Euler": with_fin(),
    "more of meshes": of_meshes(),
    "more, bursting": bursting(),
}
VARIANTS |= {phase.name: with_phase(phase) for phase in conditional_phases() if phase.rows}
SCENES = {name: feature_set(name) for name in SETS} | VARIANTS


def features(model: Model) -> set[str]:
    """Return the laws and features of a model, and the contents of its tables."""
    features = model_features(model)
    found = {law.name if law in LAWS else f"own {law.kind} law" for law in features.laws}
    found |= {f"membrane {law.name}" for law in features.membranes}
    found |= {
        f"{law.name} by {name}"
        for law in features.laws
        for name, neutral in law.neutral.items()
        if (model.parameters[name].numpy() != np.float32(neutral)).any()
    }
    found |= {f"phase {name}" for name in features.active}
    found |= {"spheres that meet"} if features.spheres_meet else set()
    found |= {"free frames"} if has_free_frames(features) else set()
    found |= {
        f"{name} {bool(value > 1 if name == 'balloons' else value)}" for name, value in switches(features).items()
    }
    return found | ({"fixed"} if any(balloon.fixed for balloon in model.scene.balloon) else set())


def switches(features: Features) -> dict[str, int]:
    """Return all features but the laws: whether each is on, or how many there are."""
    return {name: value for name, value in features._asdict().items() if isinstance(value, int)}


@cache
def some_bundled_scenes() -> list[str]:
    """Return names of a few bundled scenes that have between them all features of all, by greedy cover."""
    shown = {name: features(build_model(load_scene(name), "cpu")) for name in bundled_scenes()}
    left, found = set().union(*shown.values()), []
    while left:
        found.append(max(shown, key=lambda name: len(shown[name] & left)))
        left -= shown[found[-1]]
    return found
