"""The judgement of a swarm: predictions before a run, observations during it, and their messages.

findings    one finding, and the judgement of a run
prior       findings before the run: open inputs, system ids used twice, angles in degrees
approach    the closest approaches of vehicles
spells      durations of violated conditions
subjects    the declared outputs to be watched, and their instances
watch       the observer of a run
losses      packets lost by radio, by link and cause, as findings
reporting   its findings, in words
monitors/   the monitors that a system declares
memory      the observer's memory in a checkpoint
"""
