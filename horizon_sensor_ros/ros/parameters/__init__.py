"""The parameters: declared once, validated into settings, read from files, written as reference.

``parameter`` (what one is). Declared: ``common``, ``horizon`` (with ``aiding``, ``judgement``),
``camera``, ``target``. Validated: ``horizon_settings``, ``target_settings``, ``frame_name``.
``file`` and ``ros_yaml`` (read them), ``ignored`` (what a node does not take), ``reference``
(writes config/params.yaml and doc/parameters.md).
"""
