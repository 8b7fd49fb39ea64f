"""Interactive plots over one axis of time, the same in the review and in a report's page: signals, curves, script.

``uplot/`` is uPlot 1.6.32 as its npm package has it, with its licence (MIT): the one library of the script.
"""
