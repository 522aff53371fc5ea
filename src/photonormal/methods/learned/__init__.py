"""Networks that read a classical prior with every image."""
