"""What a trajectory costs, by maps that only training knows, and the loss that comes of it."""
