"""Balloon simulation on NVIDIA Warp: any mesh in, animated USD out.

    for frame in Simulator("squirrel_tether").run():
        print(frame.time, frame.points[0].mean(axis=0))

Names in `__all__` load on first use: importing the package stays light.
"""

import importlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from balloon_warp.system.process import LENT, without_garbage_collection

if TYPE_CHECKING:
    from balloon_warp.batch.batch import repeat_batch, run_batch
    from balloon_warp.batch.trajectories import Trajectories, TrajectoryFiles, simulate
    from balloon_warp.errors import BlowUpError, InputError, MissingExtraError, WorkersLostError
    from balloon_warp.farm.cluster import Cluster
    from balloon_warp.frame import Frame
    from balloon_warp.kernels.laws import Law, Parameter
    from balloon_warp.lab.design.design import design
    from balloon_warp.lab.design.job import Design
    from balloon_warp.lab.fit.fit import Fit, Optimum, fit
    from balloon_warp.lab.gradients import losses
    from balloon_warp.lab.gradients.derive import Gradient
    from balloon_warp.lab.gradients.gradient import Rollout, gradient
    from balloon_warp.laws import face_law, particle_law, spring_law
    from balloon_warp.mesh import PolygonMesh
    from balloon_warp.mesh.load import load_mesh
    from balloon_warp.scene import (
        Atmosphere,
        Balloon,
        Body,
        Box,
        Change,
        Force,
        Ground,
        Inflation,
        Material,
        Neck,
        Obstacle,
        Scene,
        Sphere,
        Stiffness,
        String,
        Touch,
        Tube,
        Water,
        bundled_scenes,
        load_scene,
    )
    from balloon_warp.simulator import MassProperties, Simulator
    from balloon_warp.springs import build_springs
    from balloon_warp.studio.animate import animate
    from balloon_warp.studio.export import export_stage
    from balloon_warp.studio.page.view import show, view
    from balloon_warp.studio.render import render_stage
    from balloon_warp.tools.check import CheckReport, Crossing, check_stage
    from balloon_warp.tools.compare import compare
    from balloon_warp.tools.doctor import warm_up
    from balloon_warp.tools.foil import foil_mesh, foil_parts
    from balloon_warp.tools.inspect import advise_step, inspect_mesh
    from balloon_warp.tools.remesh import remesh
    from balloon_warp.usd import StageWriter

__all__ = [
    "Atmosphere",
    "Balloon",
    "BlowUpError",
    "Body",
    "Box",
    "Change",
    "CheckReport",
    "Cluster",
    "Crossing",
    "Design",
    "Fit",
    "Force",
    "Frame",
    "Gradient",
    "Ground",
    "Inflation",
    "InputError",
    "Law",
    "MassProperties",
    "Material",
    "MissingExtraError",
    "Neck",
    "Obstacle",
    "Optimum",
    "Parameter",
    "PolygonMesh",
    "Rollout",
    "Scene",
    "Simulator",
    "Sphere",
    "StageWriter",
    "Stiffness",
    "String",
    "Touch",
    "Trajectories",
    "TrajectoryFiles",
    "Tube",
    "Water",
    "WorkersLostError",
    "advise_step",
    "animate",
    "build_springs",
    "bundled_scenes",
    "check_stage",
    "compare",
    "design",
    "export_stage",
    "face_law",
    "fit",
    "foil_mesh",
    "foil_parts",
    "gradient",
    "inspect_mesh",
    "load_mesh",
    "load_scene",
    "losses",
    "particle_law",
    "remesh",
    "render_stage",
    "repeat_batch",
    "run_batch",
    "show",
    "simulate",
    "spring_law",
    "view",
    "warm_up",
]

_HOMES = {
    "tools.inspect": (
        "advise_step",
        "inspect_mesh",
    ),
    "tools.check": (
        "CheckReport",
        "Crossing",
        "check_stage",
    ),
    "tools.compare": ("compare",),
    "lab.design.design": ("design",),
    "lab.design.job": ("Design",),
    "errors": (
        "BlowUpError",
        "InputError",
        "MissingExtraError",
        "WorkersLostError",
    ),
    "lab.fit.fit": (
        "Optimum",
        "fit",
        "Fit",
    ),
    "tools.foil": (
        "foil_mesh",
        "foil_parts",
    ),
    "frame": ("Frame",),
    "lab.gradients": ("losses",),
    "lab.gradients.derive": ("Gradient",),
    "lab.gradients.gradient": (
        "gradient",
        "Rollout",
    ),
    "studio.animate": ("animate",),
    "kernels.laws": (
        "Law",
        "Parameter",
    ),
    "laws": (
        "face_law",
        "particle_law",
        "spring_law",
    ),
    "mesh": ("PolygonMesh",),
    "mesh.load": ("load_mesh",),
    "tools.remesh": ("remesh",),
    "studio.export": ("export_stage",),
    "studio.render": ("render_stage",),
    "usd": ("StageWriter",),
    "scene": (
        "Atmosphere",
        "Balloon",
        "Box",
        "Change",
        "Force",
        "Ground",
        "Inflation",
        "Body",
        "Material",
        "Neck",
        "Obstacle",
        "Scene",
        "Sphere",
        "Stiffness",
        "String",
        "Touch",
        "Tube",
        "Water",
        "bundled_scenes",
        "load_scene",
    ),
    "simulator": (
        "Simulator",
        "MassProperties",
    ),
    "springs": ("build_springs",),
    "batch.batch": (
        "run_batch",
        "repeat_batch",
    ),
    "farm.cluster": ("Cluster",),
    "batch.trajectories": (
        "TrajectoryFiles",
        "Trajectories",
        "simulate",
    ),
    "studio.page.view": (
        "show",
        "view",
    ),
    "tools.doctor": ("warm_up",),
}

# In a source tree kernels/ and scenes/ stand beside this folder; an installed package has them inside.
if not (Path(__file__).parent / "kernels").is_dir():
    __path__.append(str(Path(__file__).parent.parent))


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("balloon-warp")
    for module, names in _HOMES.items():
        if name in names:
            with without_garbage_collection():
                home = importlib.import_module(f"{__name__}.{module}")
                return vars(home).get(name) or importlib.import_module(f"{home.__name__}.{name}")
    # with both, Python asks whether a name that is like it was meant
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name, obj=sys.modules[__name__])


def _lend(module: str, name: str) -> None:
    """Lend a function of a room to the core; its module loads when it is called."""
    LENT[name] = lambda *given: getattr(importlib.import_module(f"{__name__}.{module}"), name)(*given)


_lend("studio.animate", "snapshot")
_lend("studio.animate", "notebook_picture")
_lend("lab.statics", "stiffness_in")


def __dir__() -> list[str]:
    """List the names for tab completion, before anything is loaded."""
    return sorted({*(name for name in globals() if name.startswith("__")), *__all__, "__version__"})
