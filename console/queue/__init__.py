"""Trials that wait for their turn: the list, its file, and the thread that orders one after the other."""
