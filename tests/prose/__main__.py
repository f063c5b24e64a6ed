"""Checks prose and names against the style guide: python -m tests.prose, part of make lint."""

import sys

from tests.prose.checking import run_check

sys.exit(run_check(sys.argv[1:]))
