"""Campaigns: many trials as data, run by a crew of processes, and the report that is made of their logs."""
