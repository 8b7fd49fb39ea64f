"""A folder of flight logs as one table, and as a page: what changed from flight to flight."""
