"""The MCAP file: container, decoding, contents, recovery."""
