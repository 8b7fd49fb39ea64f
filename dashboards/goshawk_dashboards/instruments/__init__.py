"""What the vehicle estimates: disturbance, target filter, what it learns of itself. Every page shows the same."""
