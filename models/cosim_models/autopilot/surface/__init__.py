"""Driving on a surface: speed and steering, the modes of a pilot, circles, and the way back."""
