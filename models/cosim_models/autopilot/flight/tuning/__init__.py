"""AUTOTUNE: gains of the rate and angle controllers, found by twitches in flight."""
