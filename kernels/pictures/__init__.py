"""The ray caster."""
