"""Puts the dashboards' pages up: the live one and the review."""
