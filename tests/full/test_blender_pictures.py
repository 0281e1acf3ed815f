"""Blender renders our picture alike in the studio look: colors, highlights and paper, where `bpy` is installed."""

from pathlib import Path

import numpy as np
import pytest
from painted import linear
from PIL import Image

from balloon_warp import animate, load_scene, render_stage
from balloon_warp.benchmarks.blender_pictures import blender_python, render_in_blender
from balloon_warp.studio.render.stage_reader import RenderStage

SIZE = (160, 90)
pytestmark = pytest.mark.skipif(blender_python() is None, reason="Blender's module is not installed")


def shown(path: Path) -> np.ndarray:
    """Return linear values of a picture, shape (height, width, 3)."""
    return linear(Image.open(path).convert("RGB"))


def vivid(picture: np.ndarray) -> np.ndarray:
    """Return the mask of a balloon's pixels: those of a color, as all else is gray paper."""
    return np.ptp(picture, axis=2) > 0.3 * picture.max(axis=2)


@pytest.mark.parametrize("name", ["squirrel_inflate", "foil_letters", "balloon_bunch", "latex_inflate"])
def test_blender_shows_what_our_picture_shows(name: str, tmp_path: Path):
    stage, ours, blenders = (tmp_path / end for end in ("out.usdc", "ours.png", "blender.png"))
    animate(load_scene(name), stage, device="cpu")
    frame = RenderStage(stage).picture_frame
    render_stage(stage, ours, size=SIZE, device="cpu", samples=16)
    render_in_blender(stage, blenders, frame, size=SIZE, samples=32)
    one, other = shown(ours), shown(blenders)
    # Ours is framed for one frame, Blender's for the run: about as large.
    assert vivid(other).mean() == pytest.approx(vivid(one).mean(), rel=0.35)
    means = [picture[vivid(picture)].mean(axis=0) for picture in (one, other)]
    assert np.abs(means[0] - means[1]).max() < 0.12
    papers = [np.median(picture[~vivid(picture)], axis=0) for picture in (one, other)]
    assert np.abs(papers[0] - papers[1]).max() < 0.15
    # Lamps are mirrored: some of each balloon is far brighter than it is.
    peaks = [np.percentile(picture[vivid(picture)].max(axis=1), 99) for picture in (one, other)]
    peaks = [peak / mean.max() for peak, mean in zip(peaks, means, strict=True)]
    assert min(peaks) > 1.2
    assert peaks[1] > 0.6 * peaks[0]
