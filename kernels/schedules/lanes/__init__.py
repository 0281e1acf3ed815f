"""Eight worlds, or eight particles of one, in a CPU's vector registers."""
