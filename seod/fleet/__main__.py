"""`python -m seod.fleet`: started by the supervisor."""

import sys

from seod.fleet.process import main

sys.exit(main())
