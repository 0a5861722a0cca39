"""How exact a cloud's ranges are, and what the sensor's driver has done to them.

``range_noise`` (how large the noise is, and how it grows with the slant), by way of
``mixed_differences``; ranges that were smoothed over pixels: ``smoothed_noise`` (means) and
``repeated_returns`` (medians), or over time: ``temporal_filter``; ``common_noise`` (of all of a row
or column).
"""
