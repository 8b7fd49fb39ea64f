"""Many flights of `goshawk-sim`: the flight table, sweeps of one trouble, trainings that differ in one thing."""
