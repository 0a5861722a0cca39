"""Answers held against a simulation's truth, for demo and report.

``topics`` (the truth's own), ``horizon_errors``, ``target_errors``, ``nees`` (errors beside the
covariance claimed).
"""
