"""What ~/debug_image shows: ``debug_image``, drawn on a ``canvas``."""
