"""Desk of the simulated robot: the page by which a person unlocks the brakes and lets FCI in, as other programs see it.

Its interface is that of Desk's API version 1 (system 5 and newer), as far as published clients show it: franky 2.0
(franky.Desk), franka-desk 0.1 and franka-deskapi 1.0. The vendor's own description of it was not at hand. What is a
guess of ours is said where it stands.
"""
