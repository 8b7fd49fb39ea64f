"""What is known of a vehicle at one instant, as plain values: of the live view and of a recording alike."""
