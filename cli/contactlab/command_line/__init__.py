"""The command line: how a command is declared, parsed and printed.

A command is one function of `contactlab.commands`, or of a package that adds it. Its parameters are
its options, here and in Python.
"""
