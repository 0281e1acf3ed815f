"""Values of balloons at the begin and end of a frame: keyframed values, and added mass."""

from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.frames.air_along import air_kernel
from balloon_warp.kernels.frames.around import note_given_loads, ramp_inflation
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.model.state import frames_of
from balloon_warp.schedules.tables import world_state


def refresh_ramp(model: Model, state: State) -> None:
    """Update the inflation coefficients of the frame that begins."""
    launch(
        ramp_inflation,
        (model.world_count, model.balloon_count),
        inputs=[
            *(model.keyframe_times, model.parameters["keyframe_values"], model.frame_seconds),
            frames_of(model, state),
        ],
        outputs=[state.inflation_ramp],
        device=model.device,
    )


def weigh_air(model: Model, features: Features, tables: Any, state: State, numbers: wp.array | None = None) -> None:
    """Update the air at balloons, and the added mass, for the frame that begins.

    Args:
        numbers: of particles in the state, if tables have them in another order.
    """
    if features.takes_air_along or features.gas_meets_air:
        places = model.world_count, model.balloon_count
        launch(air_kernel(features), places, inputs=[tables, numbers, world_state(state)], device=model.device)


def note_pressures(model: Model, features: Features, state: State) -> None:
    """Store the given pressures of the last substep."""
    if features.pressures and not features.gas:
        time = (model.substeps - 1) * model.step_seconds
        inputs = [model.inflation_kind, time, world_state(state)]
        launch(note_given_loads, (model.world_count, model.balloon_count), inputs=inputs, device=model.device)
