"""Desk of the simulated robot: the page by which a person unlocks the brakes and lets FCI in, as other programs see it.

Desk's API version 1 (system 5 and newer) as franky 2.0, franka-desk 0.1 and franka-deskapi 1.0 show it; the vendor's
own description was not at hand. Guesses are marked where they stand.
"""
