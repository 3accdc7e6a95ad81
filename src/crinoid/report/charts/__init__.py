"""Charts and shapes of a run as data: chosen, computed and named once, for paper and for the page.

NumPy only: how anything looks is left to what draws it.
"""
