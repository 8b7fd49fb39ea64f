"""The review: recorded flights on a timeline, in the live view's scene."""
