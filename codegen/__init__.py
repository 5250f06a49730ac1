"""From a control law of model/ to the text of C files.

    ControlLaw -> derivation/ (short steps) -> program.py (graph, constants) -> optimize.py -> printing/ ->
    files.py (name: text)

dynamics.py does the same for the plant; project/ writes build files, control loop and self-test of an
exported project, from its templates/ by templates.py.
"""
