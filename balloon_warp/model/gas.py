"""Gas at the start: amounts and pressures of every world, from what the scene says. Host side."""

from collections.abc import Sequence

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.air import GAS_CONSTANT, density_of_given_air
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.seams import welded
from balloon_warp.mesh.topology import border_edges, inconsistent_edges, is_closed, mesh_edges
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene

LEAST_ROUNDNESS = 1.0e-6
"""volume over the cube of the size, of a balloon that can hold gas"""


def require_sealed(shape: BalloonShape) -> None:
    """Make sure that a balloon can hold gas.

    Raises:
        InputError: its mesh is open, has no inside, or encloses no volume.
    """
    edges = mesh_edges(shape.mesh)
    if not is_closed(edges):
        low, high = edges.ends[border_edges(edges)[0]] + 1
        helps = "--weld, which closes it," if is_closed(mesh_edges(welded(shape.mesh))) else "a closed mesh"
        raise InputError(
            f"{shape.name}: its mesh is open, so that it cannot hold gas: the first open edge goes from vertex {low} "
            f"to {high}, counting from 1; expected {helps} or another inflation.kind"
        )
    if len(inconsistent_edges(edges)):
        low, high = edges.ends[inconsistent_edges(edges)[0]] + 1
        raise InputError(
            f"{shape.name}: its faces have no common outer side, so that it cannot hold gas: the first edge where they "
            f"part goes from vertex {low} to {high}, counting from 1"
        )
    size = float(np.ptp(shape.mesh.points[shape.mesh.face_vertex_indices], axis=0).max())
    if signed_volume(shape.mesh) < LEAST_ROUNDNESS * size**3:
        raise InputError(f"{shape.name}: encloses no volume at the start, so that it cannot hold gas")


def settle_gas(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> Parameters:
    """The amounts of gas at the start, and the pressures and loads then, given ones among them.

    At the air's pressure p_a a gas is as warm as the air, so that a mole takes v = R T / p_a. In a balloon of volume V,
    n moles then have p = p_a ((n v / V)^gamma - 1) above the air's.
    """
    p_a, temperature = parameters["air_pressure"][:, None], parameters["air_temperature"][:, None]
    given, gamma = parameters["initial_gas_amounts"], parameters["gamma"]
    molar_volume = GAS_CONSTANT * temperature / p_a
    volume = np.array([max(signed_volume(shape.mesh), 1.0e-30) for shape in shapes])
    holds_gas = np.array([balloon.inflation.kind == "gas" for balloon in scene.balloon])
    compression = np.maximum(1.0 + parameters["initial_pressures"] / p_a, 0.0) ** (1.0 / gamma)
    pressed = np.array([balloon.inflation.kind == "pressure" for balloon in scene.balloon])
    amounts = np.where(np.isnan(given), compression * volume / molar_volume, given) * holds_gas
    pressures = p_a * ((amounts * molar_volume / volume) ** gamma - 1.0) * holds_gas
    pressures = pressures + parameters["keyframe_values"][:, :, 0] * pressed

    gas_density = amounts * parameters["molar_mass"] / volume
    air = density_of_given_air(*(parameters[f"air_{name}"][:, None] for name in ("pressure", "temperature", "density")))
    rise = (air - gas_density) * parameters["gravity"][:, None] * holds_gas
    centers = np.stack([shape.mass_share @ shape.mesh.points for shape in shapes]) + parameters["initial_shifts"]
    loads = np.broadcast_arrays(pressures - rise * (centers @ np.array(scene.up)), rise)
    return {
        "initial_gas_amounts": amounts,
        "initial_pressures": pressures,
        "initial_loads": np.stack(loads, axis=-1),
    }
