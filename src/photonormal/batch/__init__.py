"""Many captures: what is not done is measured, one process a capture; the results alone say what is done."""
