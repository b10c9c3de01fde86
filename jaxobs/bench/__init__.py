"""Designs beside the papers' at equal proved rate, the frontier of noise against rate, time as the state grows: all as data.

`report` draws and prints it; `jaxobs bench synthesis` runs all of it.
"""
