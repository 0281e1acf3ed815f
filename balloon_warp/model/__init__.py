"""Model of a simulation, which is fixed, and its state, which changes."""

from balloon_warp.model.model import Model, fitting
from balloon_warp.model.parameters import DueChange, Vary, worlds_of
from balloon_warp.model.plan import ModelPlan, Remark, build_model, lay_out, plan_model, remark_sentences, remarks_on
from balloon_warp.model.state import State, carried_over, copy_of, initial_state, overwrite, world_bytes

__all__ = [
    "DueChange",
    "Model",
    "ModelPlan",
    "Remark",
    "State",
    "Vary",
    "build_model",
    "carried_over",
    "copy_of",
    "fitting",
    "initial_state",
    "lay_out",
    "overwrite",
    "plan_model",
    "remark_sentences",
    "remarks_on",
    "world_bytes",
    "worlds_of",
]
