"""The judgement of a swarm: predictions before a run, observations during it, and their messages.

findings    one finding, and the judgement of a run
prior       findings before the run: open inputs, system ids used twice, angles in degrees
approach    the closest approaches of vehicles
spells      durations of violated conditions
watch       the observer of a run
memory      the observer's memory in a checkpoint
"""
