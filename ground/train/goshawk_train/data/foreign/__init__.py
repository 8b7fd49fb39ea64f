"""Data sets of another layout, converted. Needs no torch."""
