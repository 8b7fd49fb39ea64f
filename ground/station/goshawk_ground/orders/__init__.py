"""Start and Stop, put to the vehicle until it answers."""
