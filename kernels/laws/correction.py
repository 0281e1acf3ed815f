"""Position correction: after a step, springs longer than (1 + limit) times their rest length are shortened to that.

Both ends move alike, or the free one (Provot 1995).

One spring after the other, of those that share no particle side by side: springs are colored so that no two of a color
meet, and a sweep takes the colors in turn (Gauss-Seidel), which carries a correction through the balloon faster than
averaging all springs' wishes (Jacobi). Colors go by where particles stand at the start: neither the order of springs in
memory nor the numbers of particles matter.

The velocities follow: an end that is moved by c in a step of h gains c / h. Then a velocity is that of the way which a
particle really went, where otherwise it would gather speed against the limit for as long as it is pulled. The gains of
the two ends are opposite, so that momentum stays; and along the spring, so that angular momentum stays to first order
in the step.
"""

import warp as wp


@wp.func
def excess(d: wp.vec3, rest_length: float, limit: float):
    """Return the part of d, the vector along a spring, beyond the longest length allowed [m]; zero if shorter."""
    longest = (1.0 + limit) * rest_length
    squared = wp.length_sq(d)
    if squared <= longest * longest:
        return wp.vec3()
    return (1.0 - longest / wp.sqrt(squared)) * d


@wp.func
def share_of_correction(mass_share: float, mass_share_of_other: float):
    """Return one end's share of a correction: half, all beside a fixed end, or zero if it is fixed."""
    if mass_share == 0.0:
        return 0.0
    return wp.where(mass_share_of_other > 0.0, 0.5, 1.0)


@wp.func
def moves_of_ends(mass_share_p: float, mass_share_q: float, too_long: wp.vec3):
    """Return the displacements of a spring's two ends that remove an excess length [m]."""
    move_p = share_of_correction(mass_share_p, mass_share_q) * too_long
    move_q = -share_of_correction(mass_share_q, mass_share_p) * too_long
    return move_p, move_q
