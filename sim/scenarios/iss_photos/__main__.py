"""Entry point: ``python -m sim.scenarios.iss_photos``."""

import sys

from sim.scenarios.iss_photos.run import main

if __name__ == "__main__":
    sys.exit(main())
