"""A stage of the parts of a run or a batch, where no part is copied."""

from collections.abc import Sequence
from pathlib import Path

from pxr import Sdf, Usd, Vt

from balloon_warp.outputs.usd.metadata import describe_stage
from balloon_warp.scene import Scene


def write_playlist(path: Path, still: str, parts: Sequence[tuple[int, str]], last: int, scene: Scene) -> None:
    """Write a stage that plays parts one after the other, as value clips.

    Args:
        path: where to, beside the other files.
        still: the name of the stage that has all but the frames.
        parts: the first frame of each part, and its name.
        last: the last frame of the last one.
        scene: of the stage.
    """
    stage = _stage_over(path, [still], last, scene)
    clips = Usd.ClipsAPI(stage.GetDefaultPrim())
    clips.SetClipPrimPath(str(stage.GetDefaultPrim().GetPath()))
    clips.SetClipAssetPaths([Sdf.AssetPath(f"./{name}") for _, name in parts])
    clips.SetClipActive(Vt.Vec2dArray([(first, number) for number, (first, _) in enumerate(parts)]))
    clips.SetClipTimes(Vt.Vec2dArray([(0, 0), (last, last)]))
    stage.GetRootLayer().Save()


def write_overlay(path: Path, still: str, parts: Sequence[str], last: int, scene: Scene) -> None:
    """Write a stage of parts that have different prims move, as layers of it; see `write_playlist`."""
    stage = _stage_over(path, [*parts, still], last, scene)
    stage.GetRootLayer().Save()


def _stage_over(path: Path, layers: Sequence[str], last: int, scene: Scene) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    for name in layers:
        stage.GetRootLayer().subLayerPaths.append(f"./{name}")
    describe_stage(stage, scene)
    stage.SetEndTimeCode(last)
    return stage
