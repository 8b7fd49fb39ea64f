"""Flight logs to a data set: poses and target smoothed, the map fused from the depth. Needs no torch."""
