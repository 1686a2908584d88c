"""The page that shows a run in a browser: `uav-cosim view`.

replay      what the page has to know of a run, gathered in one pass over its signals
motion      where the vehicles are, thinned out so that the page stays smooth
curves      every recorded signal, thinned out so that a plot looks the same
traffic     packets: which fly when, how the links fare, what was said
block       typed arrays as one compressed text
page        the HTML document with its bundle, its recording and its rules
bundle/     what `node build.mjs ../bundle` writes from page/: JavaScript, style sheet, body, digest of the sources
"""
