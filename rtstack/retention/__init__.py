"""What becomes of old logs: which may go, and how what was known of them is kept."""
