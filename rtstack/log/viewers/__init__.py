"""What other programs need to draw a log: frames, shapes, URDF."""
