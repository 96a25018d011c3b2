"""Entry point: ``python -m sim.scenarios.mars_disk``."""

import sys

from sim.scenarios.mars_disk.run import main

if __name__ == "__main__":
    sys.exit(main())
