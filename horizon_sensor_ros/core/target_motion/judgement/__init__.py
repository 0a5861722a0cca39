"""Whether a motion that fits is to be believed.

``one_body`` (does every part of the cloud move alike), ``layers`` (does what is nearer move with
what is farther), ``ambiguity`` (does another motion look alike; ``alternatives``: which;
``hidden_patch``: or is a patch of the target hidden).
"""
