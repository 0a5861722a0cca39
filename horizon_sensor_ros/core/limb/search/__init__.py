"""Where in the frames of all cameras the limb is, to a few pixels."""
