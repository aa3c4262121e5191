"""The pipeline: one function per verb, which takes objects and returns a result.

Nothing here prints. Long work reports to a callback, and goes on where it was stopped when it is
given a folder.
"""
