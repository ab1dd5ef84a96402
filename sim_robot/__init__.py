"""The simulated cell. Only its plant reads scene and plant parameters; only `fci` and `desk` do I/O."""
