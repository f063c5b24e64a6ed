"""Models opened with their tasks: sessions, runs, motions and verdicts that studies share.

A study opens a model once, by `checked_model.open_model`. Its task, its run specs, its compiled
model, the motions of its phases, its error budget and its runs are each made once, on demand.
"""
