"""What methods and networks read, made in one place for training and for measuring."""
