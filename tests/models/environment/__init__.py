"""Tests of the surroundings of vehicles."""
