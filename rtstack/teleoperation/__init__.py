"""A person moves the arms: what is asked for, how it is filtered, and what ends it when nobody holds the clutch."""
