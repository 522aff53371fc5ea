"""Lights that nobody measured: from the photographs of the object itself."""
