"""The simulated arms behind the Franka Control Interface: TCP 1337, 1 kHz UDP, server version 10.

One process serves all arms of one plant. `rtstack sim` starts it (program.py).
"""
