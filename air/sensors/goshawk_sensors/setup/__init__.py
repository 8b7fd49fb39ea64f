"""What is asked of a camera: by its profile, by the vehicle and its policy; and what is wrong if it cannot be had."""
