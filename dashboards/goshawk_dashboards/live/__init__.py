"""The live view: vehicles that fly now, and the commands to them."""
