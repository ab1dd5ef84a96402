"""A trial: one process, one MCAP file, one result."""
