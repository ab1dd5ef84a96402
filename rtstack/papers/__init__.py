"""The studies that reproduce the papers on plants of their own."""
