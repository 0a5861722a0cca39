"""What may be wrong with a fit besides the own errors of its points, for its covariance.

``shared_error`` (what the points have in common), ``calibration_error`` (what the sensor is told),
``hidden_air`` (air that no frame shows), ``lifted_edges`` (air that another camera shows, or that
passes for blur), ``bare_ground`` (that darkens or brightens towards the limb), ``night`` (limbs by
night and beside it), ``figure_error`` and ``uneven_limb`` (the planet's shape and its limb's),
``two_fields`` (interlaced frames), ``common_cone`` (several cameras' cones as one), ``same_limb``
(limb that several cameras see).
"""
