"""`python -m hardcore.crisis`: see `app`."""

import sys

from hardcore.crisis.app import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
