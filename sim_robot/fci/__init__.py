"""The simulated arms behind the Franka Control Interface: TCP 1337, 1 kHz UDP, server version 10.

One process serves all arms of one plant. Start it with `python -m sim_robot.fci`, or `rtstack sim`.
"""
