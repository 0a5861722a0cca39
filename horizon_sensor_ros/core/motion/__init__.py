"""How the craft turns.

``gyro`` (rates to rotations), ``turn_rate`` (what moves the horizon, and how sure that is),
``gyro_trust`` (whether a gyro's rate is that one).
"""
