"""Interactive plots over one axis of time, the same in the review and in a report's page: signals, curves, script."""
