"""A log played on the arms themselves: its way, at a speed of its own, from rest and to rest, meeting nothing."""
