"""Modes between flight by hand and autonomous flight: DRIFT, POSHOLD and ZIGZAG."""
