"""The order in which AUTO flies the commands of a mission, and their places."""
