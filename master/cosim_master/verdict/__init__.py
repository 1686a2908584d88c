"""The judgement of a swarm: predictions before a run, observations during it, and their messages.

findings    one finding, and the judgement of a run
prior       known before: open inputs, system ids used twice, angles in degrees
approach    how near vehicles came to each other
spells      how long something was not as it should be
watch       the observer of a run
memory      its memory in a checkpoint
"""
