"""Entry point: ``python -m sim.scenarios.earth_images``."""

import sys

from sim.scenarios.earth_images.run import main

if __name__ == "__main__":
    sys.exit(main())
