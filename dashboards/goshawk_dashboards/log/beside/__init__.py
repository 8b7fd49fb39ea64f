"""The autopilot's own log of a flight, beside ours: read, its clock fitted, its signals by name."""
