"""A bag as one page to look at: the command `horizon_report`.

``report`` (the command). Read: ``bags``, into what was ``recorded`` and is ``usable``. Written:
``page`` and ``blocks``. Its parts: ``overview``, ``attitude``, ``residuals``, ``frames`` (with
``frame_study``, ``photos``), ``agreement``, ``target``, ``clouds``, ``errors`` (with truth),
``imu`` (beside an accelerometer).
"""
