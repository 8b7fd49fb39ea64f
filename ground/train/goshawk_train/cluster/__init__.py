"""Campaigns beyond one machine: many small units of flights, on this machine's cores or on Ray, kept as Parquet."""
