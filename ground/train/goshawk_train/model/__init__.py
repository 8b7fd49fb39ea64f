"""What a policy is: the lattice and its geometry, the network, decoding, and the files that it is kept in."""
