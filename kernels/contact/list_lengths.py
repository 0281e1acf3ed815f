"""Indices of the lengths of a world's lists, which a search empties, and of the number of substeps since it."""

import warp as wp

LOOKING, TOUCHING = wp.constant(0), wp.constant(1)
"""Particles that search, and those that have found triangles"""
PAIRS = wp.constant(2)
"""Pairs of edges, and of particles and triangles, that may touch until the next search"""
SEEKING, BOXED = wp.constant(3), wp.constant(4)
"""Edges that go through trees in a search, and pairs of edges whose boxes meet"""
SUBSTEPS = wp.constant(5)
"""Substeps in which edges have met since the search"""
LENGTHS = 6
"""Number of these"""
