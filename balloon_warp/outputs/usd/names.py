"""Names of prims: the names of the shown things, in any script, as far as USD takes it."""

import itertools
import unicodedata
from collections.abc import Collection, Iterable

from pxr import Sdf, Usd

from balloon_warp.files import legible

RESERVED = (
    *("Ground", "Floor", "Water", "Pool", "Looks", "Spheres", "Strings", "Obstacles", "NetForces", "Prototypes"),
    *("Studio", "Physics"),
)
"""Names that no balloon gets"""


def composed(name: str) -> str:
    """Return a name in Unicode's composed form, so that two names that look the same are the same."""
    return unicodedata.normalize("NFC", legible(name))


def identifier(name: str) -> str:
    """Return a name as USD takes it: letters and digits of any script stay, all else becomes _."""
    kept = "".join(letter if Sdf.Path.IsValidIdentifier(f"_{letter}") else "_" for letter in composed(name))
    return kept if Sdf.Path.IsValidIdentifier(kept) else f"_{kept[1:]}"


def prim_names(names: Iterable[str], taken: Collection[str] = ()) -> list[str]:
    """Return a valid prim name for each name, all different, and none of those that are taken."""
    chosen: list[str] = []
    for name in map(identifier, names):
        numbered = (f"{name}_{number}" for number in itertools.count(1))
        chosen.append(
            next(free for free in itertools.chain([name], numbered) if free not in (*RESERVED, *taken, *chosen))
        )
    return chosen


def show_names(layer: Sdf.Layer, paths: Iterable[Sdf.Path], names: Iterable[str]) -> None:
    """Write the names that programs are to show of prims, where their own are others."""
    for path, name in zip(paths, map(composed, names), strict=True):
        if name and name != path.name:
            layer.GetPrimAtPath(path).SetInfo("displayName", name)


def is_called(prim: Usd.Prim, name: str) -> bool:
    """Return whether a prim is the one that somebody means by a name: its own, or the one that programs show."""
    return composed(name) in (composed(prim.GetName()), composed(prim.GetDisplayName()))
