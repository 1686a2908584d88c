"""The page that shows a run while it goes on: `uav-cosim run --view`.

server      serves the page and its WebSocket on loopback, and passes requests to the run
feed        the observer that keeps the newest values and packets
traffic     packets in flight, messages, statistics of links
sending     sends drones to places, by MAVLink
parameters  the values that the reader of the page can change
document    the document with which the page begins: vehicles, signals, plots, facts
"""
