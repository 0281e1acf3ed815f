"""What happens once a frame, beside the list of phases."""
