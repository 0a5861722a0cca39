"""Answers held against a simulation's truth, for demo and report.

``topics`` (the truth's own), ``horizon_errors``, ``target_errors``, both in ``columns``; ``nees``
(errors beside the covariance claimed).
"""
