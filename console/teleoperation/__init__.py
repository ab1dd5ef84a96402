"""Teleoperation in the console: input devices, coupling of both arms, the clutch, and the target in the mailbox."""
