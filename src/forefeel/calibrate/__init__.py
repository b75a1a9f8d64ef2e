"""Calibrations: what is asked of the person, what is measured, the dated file."""
