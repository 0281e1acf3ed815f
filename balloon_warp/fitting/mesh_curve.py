"""The curve of pressure over volume of a mesh's balloon."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.fitting.rubber import Kind, law_numbers
from balloon_warp.kernels.laws.membrane import MEMBRANES
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.prepare import Treatment, prepared
from balloon_warp.springs.membrane import build_membrane
from balloon_warp.statics.balance import Balance
from balloon_warp.statics.film import FilmSkin, determinant, metric_of
from balloon_warp.statics.volume import SealedGas, Volume

Values = NDArray[np.float64]


class MeshCurve:
    """The curve of a mesh's balloon, by its statics; each asking begins where the last came to rest."""

    def __init__(self, path: Path, kind: Kind, thickness: float, volumes: Values):
        mesh = prepared(load_mesh(path), path, Treatment())
        self._volume, self._volumes = Volume(mesh), volumes
        self._kind: Kind = kind
        if not 0.0 < self._volume.of(mesh.points) < volumes.max():
            raise InputError(
                f"{path}: encloses {self._volume.of(mesh.points):.3g} m^3 at rest; expected less than the measured "
                "volumes"
            )
        membrane = build_membrane(mesh)
        parts = membrane.areas / (0.5 * np.sqrt(determinant(metric_of(membrane.edges))))
        self._film = FilmSkin(MEMBRANES[kind], {}, membrane.corners, thickness * parts, membrane.edges)
        growth = (volumes / self._volume.of(mesh.points)) ** (1.0 / 3.0)
        self._points = [mesh.points * max(factor, 1.01) for factor in growth]

    def pressures(self, values: Values) -> Values:
        """Return the pressures at the volumes [Pa], shape (n,); NaN where there is no equilibrium."""
        film, found = replace(self._film, numbers=law_numbers(self._kind, values)), np.full(len(self._volumes), 1.0e6)
        for row, volume in enumerate(self._volumes):
            points = self._points[row]
            slopes = self._volume.slopes(points)
            guess = -float((film.forces(points) * slopes).sum() / (slopes * slopes).sum())
            settled = Balance(film, self._volume, SealedGas.of(guess, volume)).settle(points)
            if settled is not None:
                self._points[row] = settled
                found[row] = SealedGas.of(guess, volume).pressure(self._volume.of(settled))
        return found
