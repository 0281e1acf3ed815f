"""Pieces that act on few particles: a launch of their own lists these first, or the thread that moves one notes it."""

from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.schedules.pieces import Piece, Step


def rare_phase(step: Step, piece: Piece) -> Phase | None:
    """Return the phase of a piece, if it is the only one, and most items stay as they are."""
    first, *others = piece.phases
    stays = not (others or piece.sums or piece.doubles or piece.leaves or piece.keeps)
    return first if stays and first.asked(step.features, step.look) else None


def acts_on_few(step: Step, piece: Piece) -> bool:
    """Return whether a block lists the particles that a piece acts on: it is apart since most have nothing to do."""
    rare = rare_phase(step, piece)
    return rare is not None and piece.item == "particle" and rare.name in step.apart


def asked_ahead(step: Step, piece: Piece) -> Phase | None:
    """Return the phase of the next piece, if it acts on few particles, and the thread that moved one knows which."""
    place = step.pieces.index(piece) + 1
    after = step.pieces[place] if place < len(step.pieces) else None
    knows = piece.item == "particle" and not (piece.sums or piece.once or acts_on_few(step, piece))
    return after.phases[0] if knows and after and acts_on_few(step, after) else None


def is_asked_ahead(step: Step, piece: Piece) -> bool:
    """Return whether the piece before notes the particles that this one acts on."""
    place = step.pieces.index(piece)
    return place > 0 and asked_ahead(step, step.pieces[place - 1]) is not None
