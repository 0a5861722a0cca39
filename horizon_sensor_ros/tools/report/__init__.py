"""A bag as one page to look at: the command `horizon_report`."""
