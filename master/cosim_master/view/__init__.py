"""The page that shows a run in a browser: `uav-cosim view`, and `run --view` while it goes on.

replay      the document of a run, gathered in one pass over its signals
motion      positions and attitudes of the vehicles, thinned out for smooth animation
curves      every recorded signal, thinned out without a visible change of its plot
traffic     packets in flight, statistics of links, the message log
block       typed arrays as one compressed text
page        the HTML document with its bundle, its recording and its rules
live/       the page of a run that goes on, and its server
bundle/     output of `node build.mjs ../bundle` in page/: JavaScript, style sheet, body, digest of the sources
"""
