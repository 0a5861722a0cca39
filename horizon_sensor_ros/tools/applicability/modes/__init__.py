"""What `horizon_applicability` can be asked, one mode a file: arguments -> files and an answer."""
