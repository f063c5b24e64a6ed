"""The Python interface: the commands' questions, asked with the same words and answered as data.

`contactlab` itself offers these functions, and loads them when they are first used.
"""
