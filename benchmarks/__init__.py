"""How fast the schedules are, side by side with a peer."""
