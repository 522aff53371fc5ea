"""``python -m photonormal`` is the command line."""

import sys

from photonormal_command import main

if __name__ == "__main__":
    sys.exit(main())
