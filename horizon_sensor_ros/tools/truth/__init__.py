"""Answers held against a simulation's truth, for demo and report: its topics, and the errors."""
