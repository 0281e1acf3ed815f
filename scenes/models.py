"""Bundled models, made again."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp
from PIL import Image

from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.scenes.model_airbag import airbag, airbag_flat
from balloon_warp.scenes.model_ball import ball, fine_ball
from balloon_warp.scenes.model_bead import bead
from balloon_warp.scenes.model_bowl import bowl
from balloon_warp.scenes.model_knot import knot
from balloon_warp.scenes.model_pillow import pillow
from balloon_warp.scenes.model_print import GASES, dots, label
from balloon_warp.scenes.model_slot import slot
from balloon_warp.scenes.model_squirrel import squirrel
from balloon_warp.scenes.model_table import table
from balloon_warp.scenes.model_toy import toy
from balloon_warp.scenes.model_turtle import turtle

MODELS = {
    "squirrel": squirrel,
    "turtle": turtle,
    "pillow": pillow,
    "bowl": bowl,
    "ball": ball,
    "fine_ball": fine_ball,
    "bead": bead,
    "knot": knot,
    "table": table,
    "slot": slot,
    "toy": toy,
    "airbag": airbag,
    "airbag_flat": airbag_flat,
}


def make_model(name: str) -> PolygonMesh:
    """Return a model by its name, in meters, y up, standing on y = 0 above the origin, points rounded to 1e-5 m."""
    with wp.ScopedDevice("cpu"):  # the same vertices in the same order, whatever the machine
        mesh = MODELS[name]()
    points = mesh.points - [0.0, mesh.points[:, 1].min(), mesh.points[:, 2].mean()]
    # + 0.0 turns -0.0 into 0.0
    return replace(mesh, points=np.round(points, 5) + 0.0, name=name)


def main(words: Sequence[str] | None = None) -> None:
    """Write every model beside this file, and the prints of the pillow and of balls.

    Args:
        words: of a command line; if missing, those that Python was started with.
    """
    described = "Write every model beside this file, and the prints of the pillow and of balls."
    argparse.ArgumentParser(prog="python -m balloon_warp.scenes.models", description=described).parse_args(words)
    for name in MODELS:
        path = Path(__file__).parent / f"{name}.obj"
        mesh = make_model(name)
        write_obj(path, mesh)
        print(f"{path}: {mesh.vertex_count} vertices, {mesh.face_count} quads")
    for name, pixels in {"pillow": dots(), **{gas: label(gas) for gas in GASES}}.items():
        image = Path(__file__).parent / f"{name}.png"
        Image.fromarray(pixels).save(image, optimize=True)
        print(f"{image}: {pixels.shape[1]}x{pixels.shape[0]} pixels")


if __name__ == "__main__":
    main()
