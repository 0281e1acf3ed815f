"""The rows of all parameters: those that no law or phase has stand here, in the form of those of laws."""

from collections.abc import Sequence

import numpy as np

from balloon_warp.kernels.laws import Law, Parameter
from balloon_warp.kernels.laws.columns import Columns, columns_of
from balloon_warp.kernels.laws.law import TINY
from balloon_warp.kernels.laws.softening import PARAMETERS as SOFTENING
from balloon_warp.kernels.laws.tearing import PARAMETERS as TEARING
from balloon_warp.kernels.substep import rows_of_phases

START = "initial_"
"""Prefix of the names of parameters that count at the start alone, and so cannot change"""
KEYFRAME_VALUES = Parameter(
    "keyframe_values",
    "N, Pa or mol/s",
    path="inflation.k_normal, inflation.pressure or inflation.pump",
    meaning="keyframed value by the kind of inflation, at each keyframe",
)
VELOCITY = "obstacle_velocity"
"""Parameter that only controls have: velocities of obstacles beside their motion [m/s]"""
ROWS: tuple[Parameter, ...] = (
    Parameter("initial_balloon_positions", "m", path="position", size=3),
    Parameter("initial_rotations", "degrees", path="rotation", size=3),
    Parameter("initial_velocities", "m/s", path="velocity", size=3),
    Parameter("initial_spins", "rad/s", path="angular_velocity", size=3),
    Parameter("initial_gas_amounts", "mol", np.nan, least=0.0, path="inflation.amount"),
    Parameter("initial_density", "kg/m^3", 940.0, least=TINY, path="material.density"),
    *SOFTENING,
    *TEARING,
    Parameter("initial_pressures", "Pa", path="inflation.start_pressure", meaning="gauge pressure of a gas"),
    Parameter("initial_sphere_positions", "m", of="sphere", path="position", size=3),
    Parameter("initial_sphere_velocities", "m/s", of="sphere", path="velocity", size=3),
    Parameter("initial_sphere_spins", "rad/s", of="sphere", path="angular_velocity", size=3),
    Parameter("string_anchor", "m", of="string", path="anchor", size=3),
    Parameter("string_length", "m", np.nan, least=TINY, of="string", path="length"),
    Parameter("string_stiffness", "N/m", 20.0, least=TINY, of="string", path="stiffness"),
    Parameter("obstacle_position", "m", of="obstacle", path="position", size=3),
    Parameter("obstacle_friction", "1", 0.5, least=0.0, of="obstacle", path="friction"),
    Parameter("obstacle_restitution", "1", 0.3, least=0.0, most=1.0, of="obstacle", path="restitution"),
    Parameter("initial_body_positions", "m", of="body", path="position", size=3),
    Parameter("initial_body_velocities", "m/s", of="body", path="velocity", size=3),
    Parameter("initial_body_spins", "rad/s", of="body", path="angular_velocity", size=3),
    Parameter("body_mass", "kg", np.nan, least=TINY, of="body", path="mass"),
    Parameter("body_friction", "1", 0.5, least=0.0, of="body", path="friction"),
    Parameter("body_restitution", "1", 0.3, least=0.0, most=1.0, of="body", path="restitution"),
    Parameter("tube_conductance", "mol/(s Pa)", least=0.0, of="tube", path="conductance"),
    Parameter("force_newtons", "N", of="force", path="newtons", size=3),
)
"""NaN is settled once all is known: a string's length, a body's mass, and an amount of gas"""


def all_columns(laws: Sequence[Law]) -> Columns:
    """Return the columns of the parameters of these laws and of the phases of the step."""
    return columns_of(laws, rows_of_phases())


def rows_of(laws: Sequence[Law]) -> tuple[Parameter, ...]:
    """Return the parameters of these laws and of the phases of the step, and all others but the keyframes.

    A balloon has several keyframes.
    """
    columns = all_columns(laws)
    return (*columns.world, *columns.balloon, *columns.sphere, *ROWS)
