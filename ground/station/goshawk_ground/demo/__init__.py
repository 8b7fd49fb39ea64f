"""`goshawk demo`: three processes, one chase, one verdict."""
