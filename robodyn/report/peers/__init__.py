"""Other libraries and the maps between their coordinates and ours; each imports its library, which is an optional package."""
