"""`python -m noslip`: the command line."""

import sys

# Python searches the current folder first, where a control.py would replace a library
if not sys.flags.safe_path:
    sys.path.append(sys.path.pop(0))

from .cli.main import main  # noqa: E402

sys.exit(main())
