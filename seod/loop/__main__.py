"""`python -m seod.loop`, as the supervisor starts it."""

import sys

from seod.loop.process import main

sys.exit(main())
