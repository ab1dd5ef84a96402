"""Tokens of programs, and the certificates of the console."""
