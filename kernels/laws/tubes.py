"""Gas that flows through tubes between balloons: by a conductance times the difference of their pressures."""

import warp as wp

from balloon_warp.kernels.laws.gas import molar_free_volume, throttled


@wp.func
def tube_flow(conductance: float, flow: float, difference: float, softness: float, step_seconds: float):
    """Return the correction of a tube's flow [mol/s] that makes it conductance times the difference of pressures.

    These are the pressures at its ends [Pa] at the end of a step, where they fall by `softness` [Pa/mol] with all that
    flows.
    """
    return (conductance * difference - flow) / (1.0 + conductance * step_seconds * softness)


@wp.func
def flow_and_fall(
    flow: float, pressures: wp.vec2, slopes: wp.vec2, moles: wp.vec2, most: wp.vec2, conductance: float,
    step_seconds: float,
):  # fmt: skip
    """Return the corrected flow of a tube [mol/s], and the free volumes that the correction brings to its ends [m^3].

    Args:
        slopes: Rise of the pressure at each end with the free volume [Pa/m^3].
        moles: Free volumes of a mole at the ends [m^3/mol].
        most: Largest flows out of the ends [mol/s].
    """
    softness = moles[0] * slopes[0] + moles[1] * slopes[1]
    more = tube_flow(conductance, flow, pressures[0] - pressures[1], softness, step_seconds)
    more = wp.clamp(flow + more, -most[1], most[0]) - flow
    return wp.vec3(flow + more, -step_seconds * more * moles[0], step_seconds * more * moles[1])


@wp.func
def gas_through_tube(source: wp.vec2d, sink: wp.vec2d, moles: float, pressures: wp.vec2, gamma: float):
    """Return the amounts [mol] and free volumes [m^3] of two gases after an amount flows from one to the other.

    `pressures` are theirs, in full [Pa]. Gas that leaves takes its part of the free volume along, and is throttled.
    """
    moved = wp.min(wp.float64(moles), source[0])
    taken = molar_free_volume(source)
    brought = throttled(taken, pressures[0], pressures[1], gamma)
    left = wp.vec2d(source[0] - moved, wp.max(source[1] - moved * wp.float64(taken), wp.float64(0.0)))
    return left, sink + moved * wp.vec2d(wp.float64(1.0), wp.float64(brought))
