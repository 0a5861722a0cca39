"""How the cameras sit, from a bag: the command `horizon_self_calibration`.

``self_calibration`` (the command), ``bag_calibration`` (what it does), ``recording`` (a bag to
frame sets), ``text`` and ``figure`` (what comes of it).
"""
