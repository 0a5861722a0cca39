"""A bag as one page to look at: the command `horizon_report`.

``report`` (the command), ``bags`` and ``usable`` (what is read), ``page`` and ``blocks`` (what is
written). Its parts: ``overview``, ``attitude``, ``residuals``, ``frames`` with ``photos``,
``target``, ``clouds``, ``errors`` (with truth), ``imu`` (beside an accelerometer).
"""
