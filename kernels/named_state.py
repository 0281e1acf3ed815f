"""Names of what balloons, spheres, bodies and other items have beside their particles, and the arrays that hold it.

A phase reaches them by the handles `state`, `working`, `spheres` and `t`. Its source says which it reads and changes,
see `effects`; what follows from that is found here: whether the gas is constant over a frame, whether spheres are
pushed, where a barrier stands. An array that no name has is not to be written.
"""

from collections.abc import Iterable
from typing import NamedTuple


class Named(NamedTuple):
    """A part of the state: the item that has it, its meaning, and its arrays."""

    item: str
    meaning: str
    arrays: tuple[str, ...]


GAS, SPHERE_PUSH, BODY_PUSH = "gas", "sphere_push", "body_push"
NAMED: dict[str, Named] = {
    GAS: Named("balloon", "amount of gas, and its free volume", ("gas_amounts", "free_volumes")),
    "gas_mass": Named("balloon", "mass of the gas, and of the air that moves along", ("gas_masses",)),
    "pressure": Named("balloon", "pressure, and how it changes", ("pressures", "pressure_slopes", "inflation_loads")),
    "flow": Named("balloon", "flow of gas, and its thrust", ("tube_flows", "vent_flows", "thrusts")),
    "sphere": Named("sphere", "course", ("sphere_positions", "sphere_velocities", "sphere_spins", "sphere_starts")),
    SPHERE_PUSH: Named("sphere", "sum of forces since it last moved, see `add_quanta`", ("sphere_quanta",)),
    "sphere_force": Named("sphere", "force of contacts, for output", ("sphere_forces",)),
    "body": Named(
        "body", "course, and inertia as it is turned", (
            "body_positions", "body_turns", "body_velocities", "body_momenta", "body_starts", "body_start_turns",
            "body_masses", "body_eases",
        ),
    ),
    BODY_PUSH: Named("body", "sums of forces and torques since it last moved", ("body_quanta", "body_turning_quanta")),
    "body_contact": Named(
        "body", "impulses between bodies, and of strings and balloons on them", (
            "body_going", "body_turning", "body_tugs", "body_twists", "body_groups", "body_gains",
            "body_touches", "body_impulses", "grips",
        ),
    ),
    "anchor": Named("string", "place of its fixed end", ("strings.anchors",)),
    "rubber": Named("triangle", "part of its tension that is left", ("membranes.wear.left",)),
    "tear": Named(
        "face", "tears, and what they leave", (
            "torn", "tear_planes", "bursts", *(f"membranes.wear.tears.{name}" for name in (
                "stresses", "face_stresses", "gone", "weakest", "ahead", "areas")),
        ),
    ),
    "force": Named("particle", "force and area vector, where they are summed", ("forces", "area_vectors")),
    "start": Named("particle", "place before the substep", ("point_starts",)),
    "look": Named("particle", "what may be near it", ("fixtures.looks", "fixtures.nearest", "near")),
    "health": Named("world", "lowest particle or sphere that was ever where it cannot be", ("first_bad",)),
    "verdict": Named("world", "whether its frame is free", ("verdicts", "ways", "any_busy")),
    "touch": Named(
        "particle", "what touches it, in sums and lists", (
            "contacts", "touched", "forces_taken", "force_quanta", "lumps", "contact_impulses", "catches",
            "catch_counts", "contact_shares", "contact_quanta", "contact_stops", "layer_quanta", "solid_shares",
            "solid_quanta", "ridge_budgets", "ridge_counts", "ridge_pairs", "ridge_radii", "edge_pairs", "list_lengths",
            "needs", "overflow",
        ),
    ),
}  # fmt: skip
"""State by its names, beside points, velocities and the values that phases write and items keep"""
OF_ARRAY = {array: name for name, named in NAMED.items() for array in named.arrays}


def names_of(arrays: Iterable[str]) -> frozenset[str]:
    """Return the names of arrays, those that have one."""
    return frozenset(OF_ARRAY[array] for array in arrays if array in OF_ARRAY)
