"""Modes in which the vehicle turns at angular velocities: ACRO, FLIP, and THROW, which rights it in the air."""
