"""Views of a result: figures, page, film, export, live, notebook.

May import ``studies`` and ``inverse`` and lower folders.
"""
