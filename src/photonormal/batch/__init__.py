"""Many captures: what is not done is measured, one process a capture; what is done is told by the results alone."""
