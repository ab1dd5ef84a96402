"""The safety judge: the only place that may change a torque. Imports the hardware contract and nothing else of ours."""
