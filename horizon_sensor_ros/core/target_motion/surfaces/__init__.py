"""What surfaces a range image shows.

``planes`` (one at each pixel; ``holes``: in spite of lone missing returns), those of thin
``parts``, ``edges``; ``surfels`` has all of them, as one view of the target.
"""
