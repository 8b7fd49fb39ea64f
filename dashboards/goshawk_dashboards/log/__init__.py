"""Recordings: read back whole or damaged, cut into phases, shown at an instant, mended."""
