"""The limb under air so thick that it hides the ground."""
