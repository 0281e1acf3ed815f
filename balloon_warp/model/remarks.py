"""Remarks on values that were not meant, or are not those that were asked for."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws.gas import max_pressure
from balloon_warp.mesh.polygon_mesh import METERS, NO_AXIS
from balloon_warp.mesh.seams import size_of
from balloon_warp.model.model import Model
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.state import State
from balloon_warp.scene import Balloon, Scene
from balloon_warp.system.warp_threads import lock_of

SMALLEST, LARGEST = 0.02, 30.0
"""Range of balloon sizes without a warning [m]"""
TOLD = (0.002, 300.0)
"""Range of sizes without a warning, where the unit is given [m]"""
THICKEST = 0.05
"""Largest wall thickness over a balloon's size"""
HEAVIEST = 100.0
"""Largest mass over that of the air in a sphere of the balloon's size"""
LIGHT = 5.0
"""Largest mass without a warning [kg]: a mesh by itself has less"""
LIFTED = 100.0
"""Largest lift by helium over weight"""
AIR = 1.2
"""Density of air [kg/m^3]"""


def implausible_values(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> list[str]:
    """Return warnings of values that may be in another unit, or of another sign, in any world.

    Of gravity, and of balloons' sizes, walls, masses and lift. Also of meshes turned to an up axis that their files do
    not name.
    """
    found = []
    if (gravity := float(parameters["gravity"].min())) < 0.0:
        found.append(f"gravity: {gravity:g} m/s2 pulls up, since positive is down; meant {-gravity:g}?")
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        size, mass = size_of(shape.mesh), float(parameters["mass"][:, number].max())
        if not SMALLEST <= size <= LARGEST and balloon.unit is None:
            found.append(f"{shape.name}: {size:.3g} m? {_helps(balloon, shape, size)}")
        elif not TOLD[0] <= size <= TOLD[1]:
            found.append(f"{shape.name}: {size:.3g} m? --unit {balloon.unit}?")
        if scene.up_axis != "Y" and isinstance(balloon.mesh, Path) and not shape.mesh.up_known:
            found.append(
                f"{shape.name}: its {NO_AXIS}, so its Y is turned to up_axis, {scene.up_axis}; --up {scene.up_axis} "
                f'(up = "{scene.up_axis}") keeps the mesh as it is'
            )
        thickness = float(parameters["thickness"][:, number].max()) if balloon.material.is_membrane else 0.0
        if thickness > THICKEST * size:
            wall = f"a wall {thickness:.3g} m thick, for a balloon of {size:.3g} m?"
            found.append(f"{shape.name}: {wall} material.thickness is in meters")
        if mass > max(LIGHT, HEAVIEST * AIR * np.pi / 6.0 * size**3):
            found.append(
                f"{shape.name}: a mass of {mass:.3g} kg, for a balloon of {size:.3g} m? Masses are in kilograms"
            )
        lift, weight = float(parameters["helium"][:, number].max()), float(np.abs(parameters["gravity"]).max())
        if lift > LIFTED * max(weight, 1.0):
            found.append(
                f"{shape.name}: helium accelerates upward by {lift:g} m/s2? {1.2 * weight:.3g} lets it rise slowly"
            )
    return found


def _helps(balloon: Balloon, shape: BalloonShape, size: float) -> str:
    """Return the option or field that would give the balloon an ordinary size."""
    units = [unit for unit in ("cm", "mm", "in", "ft") if SMALLEST <= size * METERS[unit] <= LARGEST]
    if size > LARGEST and units and not shape.mesh.unit_known:
        return f"--unit {units[0]}?"
    return f"balloon.scale = {10.0 ** -round(np.log10(size)) * balloon.scale:g}?"


@dataclass(frozen=True)
class Remark:
    """Remark on a world."""

    kind: Literal["unsettled", "overstretched", "pressed"]
    world: int
    frame: int
    sentence: str


def remarks_on(model: Model, state: State, worlds: NDArray[np.integer] | None = None) -> list[Remark]:
    """Return the current remarks, world by world.

    Args:
        model: Model that was simulated.
        state: State of all its worlds.
        worlds: Numbers by which the worlds are named; their order, when missing.
    """
    with lock_of(model.device):
        return _found(model, state, np.arange(model.world_count) if worlds is None else worlds)


def _found(model: Model, state: State, worlds: NDArray[np.integer]) -> list[Remark]:
    unsettled, overstretched = state.unsettled.numpy(), state.overstretched.numpy()
    found = []
    for row in np.flatnonzero(unsettled[:, 0]).tolist():
        world, frame = int(worlds[row]), int(unsettled[row, 0])
        found.append(Remark("unsettled", world, frame, _unsettled(model, frame, world, float(unsettled[row, 1]))))
    for row in np.flatnonzero(overstretched).tolist():
        world, frame = int(worlds[row]), int(overstretched[row])
        found.append(Remark("overstretched", world, frame, _overstretched(model, frame, world, row)))
    for row, balloon in np.argwhere(state.pressed.numpy()).tolist():
        world, frame = int(worlds[row]), int(state.pressed.numpy()[row, balloon])
        found.append(Remark("pressed", world, frame, _pressed(model, frame, world, row, balloon)))
    return found


def remarks_in_sentences(model: Model, state: State) -> list[str]:
    """Return remarks on a model and a state as sentences, as `remarks_on`."""
    return remark_sentences(remarks_on(model, state))


def remark_sentences(remarks: Sequence[Remark]) -> list[str]:
    """Return one sentence for each kind: of its first world, and how many others there are."""
    counts = Counter(remark.kind for remark in remarks)
    firsts = {remark.kind: remark for remark in sorted(remarks, key=lambda remark: remark.world, reverse=True)}
    more = {kind: f" (and {_others(count - 1)})" if count > 1 else "" for kind, count in counts.items()}
    return [f"{firsts[kind].sentence}{more[kind]}" for kind in counts]


def _others(count: int) -> str:
    return "1 more world" if count == 1 else f"{count:,} more worlds"


def _unsettled(model: Model, frame: int, world: int, change: float) -> str:
    said = model.scene.solver_iterations
    helps = "more substeps or softer springs help" if said == "auto" else 'solver_iterations = "auto" helps'
    return (
        f'solver "projective": the iterations did not converge in frame {frame} of world {world}: the last one changed '
        f"the springs' displacements by {change:.1%}, so balloons are too stiff or too small; {helps}"
    )


def _overstretched(model: Model, frame: int, world: int, row: int) -> str:
    parameters = {name: model.parameters[name].numpy() for name in ("gent_limit", "most_stretch")}
    number = [balloon.material.law for balloon in model.scene.balloon].index("gent")
    limit, most = (float(values[row % len(values), number]) for values in parameters.values())
    lock = (0.5 * (limit + 3.0)) ** 0.5
    return (
        f"material.most_stretch: rubber exceeded a biaxial stretch of {most:.3g} in frame {frame} of world {world}; "
        f'beyond, the tension of "gent", which locks at {lock:.3g}, is extrapolated; less gas or pressure, a larger '
        "gent_limit or a larger most_stretch helps"
    )


def _pressed(model: Model, frame: int, world: int, row: int, balloon: int) -> str:
    masses = model.parameters["mass"].numpy()
    bound = model.shapes[balloon].pressure_bound
    most = max_pressure(bound, float(masses[row % len(masses), balloon]), model.step_seconds)
    return (
        f"{model.shapes[balloon].name}: its gas was pressed in frame {frame} of world {world} and pushed with just "
        f"{most:,.3g} Pa, at which its skin is stable in {model.substeps:,} substeps a frame; more substeps help"
    )
