"""Net forces of pairs of things, on the device, once a frame."""

import warp as wp

from balloon_warp.kernels.measure.contacts import FaceTable, sum_contacts
from balloon_warp.launching import launch
from balloon_warp.model import Model, State


class ContactSums:
    """Sum the contacts of particles with things by balloon and thing: `state.contact_forces` and the like."""

    def __init__(self, model: Model):
        self._model = model
        self._offsets = wp.array(model.particle_offsets, dtype=wp.int32, device=model.device)
        self._faces = FaceTable()
        for name in ("particle_face_offsets", "particle_faces", "face_offsets", "face_particles"):
            setattr(self._faces, name, getattr(model, name))

    def __call__(self, state: State) -> None:
        """Sum the frame that ends."""
        launch(
            sum_contacts,
            state.contact_forces.shape,
            inputs=[self._offsets, self._faces, self._model.frame_seconds, state.points, state.contact_impulses],
            outputs=[
                *(state.contact_forces, state.contact_torques, state.contact_areas, state.contact_pressures),
                state.contact_places,
            ],
            device=self._model.device,
        )
