"""The one place that opens a user's files: regular files only, and no decoder works beyond the memory allowed."""
