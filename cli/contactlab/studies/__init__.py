"""Studies of a scene or a model: check, effects, stability and tradeoff.

Each is a function `run(request, session) -> report`, in a module or package of its own: the request
holds the options of its command, the session (`contactlab.tasks.session`) where and how runs
are made, and the report is plain data, a model of `contactlab.schema`. A further study goes next
to these, and its command only prints the report.
"""
