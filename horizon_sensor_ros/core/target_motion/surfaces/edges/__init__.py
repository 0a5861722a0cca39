"""Lines where surfaces end or meet: ``detection`` finds all of them.

``edges`` (what they come back as), ``ends`` (of faces, and both sides of thin parts), ``creases``
(between two faces). Ends are found in the order ``places`` (pixels where a surface ends),
``neighbours`` (which of them may lie on one line), ``lines`` (through them), ``runs`` (which err
together), ``hidden_ends`` (those that may be none).
"""
