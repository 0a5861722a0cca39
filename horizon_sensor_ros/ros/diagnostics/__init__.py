"""What nodes say about themselves.

On /diagnostics: ``diagnostics`` (whatever is sensed), ``horizon_diagnostics`` with ``own_counts``,
``target_diagnostics``. In the log: ``state_log``.
"""
