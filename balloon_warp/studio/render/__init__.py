"""Pictures of a stage."""

from balloon_warp.studio.render.render import render_stage

__all__ = ["render_stage"]
