"""What `horizon_applicability` can be asked, one mode a file: arguments -> files and an answer.

``field`` (and the error in it), ``quality``, ``mounting``, ``paper_figure``.
"""
