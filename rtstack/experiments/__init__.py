"""The engine of experiments, whose kinds are plug-ins: cases of a specification, rows by workers, a report of rows."""
