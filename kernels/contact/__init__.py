"""Contact: search for pairs, response of balloons, and impulses of spheres, edges, ridges and bodies."""
