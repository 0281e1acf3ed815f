"""Octets of items that have no particle in common, so that what eight of them add is the same in any order."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.lanes import LANE_COUNT

LANES = int(LANE_COUNT)
OCTETS_TRIED = 32
"""Number of octets with room that an item is tried in before it begins one of its own"""


def octets_apart(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a place in octets for each item, so that no two of an octet share a corner; each octet has one at least.

    Items of an octet are far from each other in the list, where neighbors mostly follow each other. The few that share
    corners nevertheless go where there is room, or into octets of their own.

    Args:
        corners: particles of each item, shape (n, corners).
    """
    count = len(corners)
    octet_count = -(-count // LANES)
    lanes, octets = np.divmod(np.arange(count), max(octet_count, 1))
    places = LANES * octets + lanes
    crowded = _crowded(corners, octets)
    if not len(crowded):
        return places
    is_kept = np.ones(count, dtype=bool)
    is_kept[crowded] = False
    filled = np.zeros(LANES * octet_count, dtype=bool)
    filled[places[is_kept]] = True
    begun = octet_count
    room = {octet: np.flatnonzero(~filled[LANES * octet :][:LANES]).tolist() for octet in _with_room(filled)}
    taken = {octet: set(corners[is_kept & (octets == octet)].ravel().tolist()) for octet in room}
    for item in crowded.tolist():
        own = set(corners[item].tolist())
        octet = next((each for each in [*room][-OCTETS_TRIED:] if taken[each].isdisjoint(own)), begun)
        if octet == begun:
            room[octet], taken[octet], begun = list(range(LANES)), set(), begun + 1
        taken[octet] |= own
        places[item] = LANES * octet + room[octet].pop(0)
        if not room[octet]:
            del room[octet]
    return places


def _with_room(filled: NDArray[np.bool_]) -> list[int]:
    """Return the octets that are not full."""
    return np.flatnonzero(~filled.reshape(-1, LANES).all(axis=1)).tolist()


def _crowded(corners: NDArray[np.int64], octets: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the items that share a corner with one before of their octet."""
    count, width = corners.shape
    owners = np.repeat(np.arange(count), width)
    entries = np.unique(np.column_stack([np.repeat(octets, width), corners.ravel(), owners]), axis=0)
    again = (entries[1:, :2] == entries[:-1, :2]).all(axis=1)
    return np.unique(entries[1:, 2][again])
