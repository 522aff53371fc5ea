"""``python -m photonormal`` is the command line."""

import sys

from photonormal.cli import main

sys.exit(main())
