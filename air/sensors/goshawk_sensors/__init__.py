"""The vehicle's camera: from a RealSense, an OAK-D or a recording to the images that the policy was trained with."""
