"""How the cameras sit, from a bag: the command `horizon_self_calibration`."""
