"""What the arms follow: a scripted demonstration, a recording, and the extended references made from it."""
