"""What a suspended mass says where it rests: the pull equals the weight."""
