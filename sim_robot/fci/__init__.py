"""The simulated arms behind the Franka Control Interface, version 10: one process, one plant (`rtstack sim`)."""
