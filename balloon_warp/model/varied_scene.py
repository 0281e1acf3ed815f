"""The scene of worlds that differ, where their values ask for another kind of inflation than the scene has."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.mesh.load import LOADERS
from balloon_warp.model.vary import VaryError
from balloon_warp.scene import Scene, SceneLike, load_scene
from balloon_warp.scene.inflation_kinds import KIND_OF_FIELD
from balloon_warp.scene.load import pairs_of
from balloon_warp.scene.overrides import Override, OverrideError, override_scene

FILLING = re.compile(r"balloon\.(?:(\d+)\.)?inflation\.(\w+)")
"""Paths of fields of inflations"""


def scene_to_vary(
    source: SceneLike, vary: Mapping[str, Any] | None, overrides: Mapping[str, Any] | Iterable[Override] = ()
) -> Scene:
    """Load a scene whose values at some paths will differ between worlds.

    As with `--set`, a balloon gets the kind of inflation that they ask for, where nothing names one; and a mesh by
    itself gets no pump beside litres that differ.

    Args:
        source: as of `load_scene`.
        vary: values that differ, by dotted paths.
        overrides: as of `load_scene`.

    Raises:
        InputError: as `load_scene`.
        VaryError: no world can have the largest of the values at a path.
    """
    asked = _fillings(vary) if isinstance(vary, Mapping) else []
    if _is_bare_mesh(source):
        given = pairs_of(overrides)
        try:
            return load_scene(source, [*given, *asked])
        except OverrideError as mistake:
            if mistake.number < len(given):
                raise
            raise VaryError(mistake, asked[mistake.number - len(given)][0]) from None
    scene = source if isinstance(source, Scene) and not overrides else load_scene(source, overrides)
    for path, value in asked:
        if _asks_for_another_kind(scene, path):
            try:
                scene = override_scene(scene, [(path, value)], other_kinds=True)
            except InputError as mistake:
                raise VaryError(mistake, path) from None
    return scene


def _is_bare_mesh(source: SceneLike) -> bool:
    if isinstance(source, str | Path):
        return Path(source).suffix.lower() in LOADERS
    return not isinstance(source, Scene)


def _fillings(vary: Mapping[str, Any]) -> list[Override]:
    """Return paths of inflations among those that differ, and the value of each that is farthest from 0."""
    asked: list[Override] = []
    for path, values in vary.items():
        named = FILLING.fullmatch(path)
        if named and named[2] in KIND_OF_FIELD:
            try:
                numbers: Sequence[float] = np.ravel(np.asarray(values, dtype=np.float64)).tolist()
            except (TypeError, ValueError):  # which is complained of with all that differs
                continue
            if np.isfinite(numbers).any():
                asked.append((path, max(filter(np.isfinite, numbers), key=abs)))
    return asked


def _asks_for_another_kind(scene: Scene, path: str) -> bool:
    """Return whether a path belongs to another kind of inflation than its balloons have, all of which leave it open."""
    named = FILLING.fullmatch(path)
    assert named
    balloons = scene.balloon[int(named[1]) :][:1] if named[1] else scene.balloon
    inflations = [balloon.inflation for balloon in balloons]
    return not any(each.names_its_kind for each in inflations) and any(
        each.kind != KIND_OF_FIELD[named[2]] for each in inflations
    )
