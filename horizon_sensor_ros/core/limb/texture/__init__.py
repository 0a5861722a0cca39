"""What cloud and ground beside the limb do to its edge, and the likeliest place in spite of it."""
