"""Command line tools: bags, field of applicability, demo."""
