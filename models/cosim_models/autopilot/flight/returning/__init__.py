"""The way back along the flown path: the points that are kept of it, and SMART_RTL."""
