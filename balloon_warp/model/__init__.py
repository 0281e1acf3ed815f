"""What is simulated: the model (fixed) and the state (changes)."""

from balloon_warp.model.build import build_model
from balloon_warp.model.model import Model
from balloon_warp.model.state import State, initial_state

__all__ = ["Model", "State", "build_model", "initial_state"]
