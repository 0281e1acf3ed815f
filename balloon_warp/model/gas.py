"""Gas as the host settles it: at the start, from the scene's amounts and pressures, and where its gamma changes."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.air import ALIKE, GAS_CONSTANT, HIGHEST, density_of_given_air
from balloon_warp.kernels.laws.gas import STANDARD_PRESSURE
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.seams import open_seam, welded
from balloon_warp.mesh.topology import border_edges, inconsistent_edges, is_closed, mesh_edges, signed_volume
from balloon_warp.model.model import Model
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.spectrum import ALL
from balloon_warp.model.state import State
from balloon_warp.scene import Scene

LARGEST_OPENING = 0.25
"""Largest area of openings over a balloon's area at the start"""
LEAST_ROUNDNESS = 1.0e-6
"""Least volume over the cube of the size, for a balloon that can hold gas"""


def require_sealed(shape: BalloonShape) -> None:
    """Make sure that a balloon can hold gas.

    Raises:
        InputError: its mesh is open, has no inside, or encloses no volume.
    """
    edges = mesh_edges(shape.mesh)
    if not is_closed(edges):
        low, high = edges.ends[border_edges(edges)[0]] + 1
        helps = f"{weld}, which closes it," if (weld := _closing_weld(shape.mesh)) else "a closed mesh"
        raise InputError(
            f"{shape.name}: an open mesh cannot hold gas; the first open edge goes from vertex {low} to {high}, "
            f"counting from 1; expected {helps} or another inflation.kind"
        )
    if len(inconsistent_edges(edges)):
        low, high = edges.ends[inconsistent_edges(edges)[0]] + 1
        raise InputError(
            f"{shape.name}: a surface that is not orientable cannot hold gas; the first edge of opposite winding goes "
            f"from vertex {low} to {high}, counting from 1"
        )
    size = float(np.ptp(shape.mesh.points[shape.mesh.face_vertex_indices], axis=0).max())
    if signed_volume(shape.mesh) < LEAST_ROUNDNESS * size**3:
        raise InputError(f"{shape.name}: encloses no volume at the start and cannot hold gas")


def _closing_weld(mesh: PolygonMesh) -> str | None:
    """Return the option that closes an open mesh, if one does."""
    if is_closed(mesh_edges(welded(mesh))):
        return "--weld"
    seam = open_seam(mesh)
    return f"--weld {seam.weld}" if seam and seam.closes else None


def require_openings(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> None:
    """Make sure that gas can leave through necks and leaks.

    Raises:
        InputError: one is too wide for its balloon, or the gas weighs nothing.
    """
    for number, shape in enumerate(shapes):
        diameter = float(parameters["neck_diameter"][:, number].max())
        leak = float(parameters["leak"][:, number].max())
        widest = np.sqrt(LARGEST_OPENING * shape.area * 4.0 / np.pi)
        if diameter > widest:
            raise InputError(
                f"balloon.{number}.neck.diameter: must be at most {widest:.3g} m, for {shape.name} has "
                f"{shape.area:.3g} m^2 (got {diameter:g})"
            )
        if leak > LARGEST_OPENING * shape.area:
            raise InputError(
                f"balloon.{number}.inflation.leak: must be at most {LARGEST_OPENING * shape.area:.3g} m^2, for "
                f"{shape.name} has {shape.area:.3g} m^2 (got {leak:g})"
            )
        if (diameter > 0.0 or leak > 0.0) and float(parameters["molar_mass"][:, number].min()) <= 0.0:
            raise InputError(
                f"balloon.{number}.inflation.molar_mass: must be above 0 where gas leaves, since the flow depends on "
                "its density (got 0)"
            )


def settle_gas(
    scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters, rounded: bool = True
) -> Parameters:
    """Return the initial amounts and free volumes of gas, and all initial pressures and loads.

    It is as warm as the air then, so that n moles in the volume V have p = n R T / V, and the free volume
    V (p / p_0)^(1 / gamma), see `kernels.laws.gas`.

    Args:
        rounded: whether to round as devices do; unrounded values can be derived.
    """
    heights = parameters["initial_centers"] @ np.array(scene.up)
    p_a, temperature, air = _air_around(parameters, heights)
    given, gamma = parameters["initial_gas_amounts"], parameters["gamma"]
    volume = np.array([max(signed_volume(shape.mesh), 1.0e-30) for shape in shapes])
    holds_gas = np.array([balloon.inflation.kind == "gas" for balloon in scene.balloon])
    pressed = np.array([balloon.inflation.kind == "pressure" for balloon in scene.balloon])
    asked = np.maximum(p_a + parameters["initial_pressures"], 0.0) * volume / (GAS_CONSTANT * temperature)
    amounts = np.where(np.isnan(given), asked, given) * holds_gas
    inside = amounts * GAS_CONSTANT * temperature / volume
    pressures = (inside - p_a) * holds_gas + parameters["keyframe_values"][:, :, 0] * pressed

    gas_density = amounts * parameters["molar_mass"] / volume
    rise = (air - gas_density) * parameters["gravity"][:, None] * holds_gas
    loads = np.broadcast_arrays(pressures - rise * heights, rise)
    free_volumes = volume * (inside / STANDARD_PRESSURE) ** (1.0 / gamma)
    # rounded as by kernels that pump, so that gas that is pumped later is until then as without a pump
    number = np.float32 if rounded else np.float64
    molar = number(GAS_CONSTANT) * parameters["air_temperature"].astype(number) / number(STANDARD_PRESSURE)
    as_warm = amounts * molar.astype(np.float64)[:, None]
    return {
        "initial_gas_amounts": amounts,
        "initial_free_volumes": np.where(gamma == 1.0, as_warm, free_volumes),
        "initial_pressures": pressures,
        "initial_loads": np.stack(loads, axis=-1),
    }


def _air_around(
    parameters: Parameters, heights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return pressure [Pa], temperature [K] and density [kg/m^3] of the air at each balloon, shape (W, B).

    As in `kernels.laws.air.air_of_height`.
    """
    names = ("air_pressure", "air_temperature", "air_density", "air_lapse", "gravity")
    pressure, temperature, given, lapse, gravity = (parameters[name][:, None] for name in names)
    density = density_of_given_air(pressure, temperature, given)
    falls = lapse > ALIKE
    colder = np.minimum(np.where(falls, lapse, 0.0) * heights / temperature, HIGHEST)
    little = np.abs(colder) < 1.0e-6
    more = np.where(little, 1.0 + 0.5 * colder, -np.log1p(-colder) / np.where(little, 1.0, colder))
    ratio = np.exp(-density * np.where(falls, gravity, 0.0) * heights * more / pressure)
    return pressure * ratio, temperature * (1.0 - colder), density * ratio / (1.0 - colder)


def pressure_bounds(scene: Scene, shapes: Sequence[BalloonShape]) -> list[float]:
    """Return each balloon's largest pressure of gas, over its mass and times the step squared [1/m].

    There is no bound where no gas is sealed, where the solver is stable at any step, and in water, whose pressure on
    the skin is above the air's, too.
    """
    unbounded = scene.solver == "projective" or scene.water is not None
    kinds = [balloon.inflation.kind for balloon in scene.balloon]
    return [
        shape.pressure_bound if kind == "gas" and not unbounded else ALL
        for kind, shape in zip(kinds, shapes, strict=True)
    ]


def keep_pressures(model: Model, state: State, parameters: Mapping[str, ArrayLike]) -> None:
    """Keep pressure p and volume of gas whose gamma is about to change.

    Its free volume becomes V_0 (p / p_0)^(1 / gamma - 1 / gamma_before).

    Args:
        parameters: those that change, by their names in `Model.parameters`.
    """
    if "gamma" in parameters:
        now = {name: array.numpy().astype(np.float64) for name, array in model.parameters.items()}
        loads = state.inflation_loads.numpy().astype(np.float64)
        above = state.pressures.numpy() - loads[..., 0]
        heights = np.divide(above, loads[..., 1], out=np.zeros_like(above), where=loads[..., 1] != 0.0)
        outside, temperature, _ = _air_around(now, heights)
        inside, warmth = outside + state.pressures.numpy(), temperature / now["air_temperature"][:, None]
        before, after = now["gamma"], np.asarray(parameters["gamma"])
        more = np.maximum(inside / STANDARD_PRESSURE, 1e-30) ** (1.0 / after - 1.0 / before)
        more = more * np.where(before == 1.0, warmth, 1.0) / np.where(after == 1.0, warmth, 1.0)
        state.free_volumes.assign(state.free_volumes.numpy() * more)
