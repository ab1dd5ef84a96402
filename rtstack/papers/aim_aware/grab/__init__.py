"""Does the monitor find what goes wrong in a grab, and nothing else? 400 trials with faults, 400 good ones."""
