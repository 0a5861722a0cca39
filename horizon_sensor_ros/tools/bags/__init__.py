"""Bags in and out: `horizon_replay`, `horizon_bag_from_images`, `horizon_bag_to_csv`."""
