"""Entry point: ``python -m sim.scenarios.leo_sensors``."""

import sys

from sim.scenarios.leo_sensors.run import main

if __name__ == "__main__":
    sys.exit(main())
