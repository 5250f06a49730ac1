"""`python -m noslip`: the command line."""

import sys

if not sys.flags.safe_path:  # Python searches the current folder first, where a control.py would replace a library
    sys.path.append(sys.path.pop(0))

from .cli.main import main  # noqa: E402

sys.exit(main())
