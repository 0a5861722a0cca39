"""Files that people write: ``yaml_file`` (within bounds), ``resources`` (that parameters name)."""
