"""Pictures of a stage."""

from balloon_warp.outputs.render.render import render_stage

__all__ = ["render_stage"]
