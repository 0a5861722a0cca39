"""The command line tools.

``bags`` (replay, bags from images, tables from bags), ``calibration`` (how the cameras sit),
``applicability`` (where a mounting sees the horizon), ``demo`` (a flight past the nodes),
``report`` (a bag as one page), ``truth`` (answers held against a simulation's).

What they share: ``command`` (signals, errors, exit codes), ``command_errors`` (why not),
``standard_streams`` (what cannot be printed), ``output_files`` (there only when whole),
``camera_file`` and ``horizon_parameters`` (read what a person wrote), ``reference_topics`` (nadir
and altitude from elsewhere), ``package_share`` (the package's own files), ``private_domain`` (runs
side by side), ``reasons`` (counted, for a person), ``colours`` (of what is drawn).
"""
