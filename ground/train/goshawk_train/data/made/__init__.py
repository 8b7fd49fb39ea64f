"""A data set made in units of one scene, by the cores of this machine or by Ray. Needs no torch."""
