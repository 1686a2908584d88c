"""Decisions about arming, modes and fail-safes."""
