"""Training on the simulated cell: a fault that comes when it is not expected, and what the operator did about it."""
