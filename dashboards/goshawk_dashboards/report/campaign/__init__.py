"""Many flights of the simulator as one page: outcomes, distributions, and maps of single flights."""
