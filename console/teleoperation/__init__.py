"""An operator's hand in the console: devices, both arms as one, the clutch, and what goes into the mailbox."""
