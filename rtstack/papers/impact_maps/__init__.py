"""Validation of rigid impact maps by reference spreading: Sections V and VI of the impact-map paper."""
