"""The 3-D view: what is drawn of a snapshot, and where each viewer's camera stands."""
