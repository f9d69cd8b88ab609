"""`python -m pirlc`."""

import sys

from pirlc.cli import main

sys.exit(main())
