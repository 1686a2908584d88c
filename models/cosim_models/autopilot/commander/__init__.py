"""Arming, mode requests, fail-safes: who decides."""
