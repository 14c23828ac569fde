"""What concerns the process and the machine: threads and locks, files that are written whole, the cache on disk."""
