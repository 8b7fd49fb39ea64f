"""One training: its loop, what it begins with, and how good it is."""
