"""What is known of absolute rotations beforehand, as a graph that holds the world."""
