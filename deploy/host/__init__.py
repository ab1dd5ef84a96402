"""Sets a PC up for two real arms: a plan of changes, shown or applied, and taken back to the byte."""
