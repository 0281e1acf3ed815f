"""Balloons at rest: energies, forces and stiffness of springs, films and gas on the host, in float64."""
