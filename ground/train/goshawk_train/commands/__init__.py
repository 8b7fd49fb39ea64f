"""The commands under `goshawk` that need the trainer, a module each group. What needs torch is imported in them."""
