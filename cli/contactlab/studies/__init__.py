"""Studies of a scene or a model: check, effects, stability and tradeoff.

Each is a function `run(request, session) -> report`, in a module or package of its own: the request
says what its command's options say, the session (`contactlab.tasks.session`) where and how runs
are made, and the report is plain data, a model of `contactlab.schema`. A further study goes beside
these, and its command only prints the report.
"""
