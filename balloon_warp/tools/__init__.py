"""Tools: commands beside a simulation, checks of meshes, stages and the installation, remeshing, foil, comparison."""
