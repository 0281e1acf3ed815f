"""Foil balloons: two flat sheets of quads with one outline, sewn at the rim.

An outline comes from letters (`letters`) or a drawing (`drawing`), as polygons of Shapely's (`outlines`). Each becomes
a sheet of even quads (`sheet`), of the squares of a grid (`grid`) and a row of quads around them (`rim`); two sheets
are sewn (`sew`), and `make` does all of it. The package needs the extra `foil`, which loads on demand.
"""
