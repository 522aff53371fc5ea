"""Photographs -> functions of the light, pixel by pixel, in the files that viewers of RTI open (`files.FORMATS`)."""
