"""Between a capture and a method: windows, lamps, priors, memory and devices. A method sees none of them."""
