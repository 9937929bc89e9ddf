"""`python -m seod.gateway`, as the supervisor starts it."""

import sys

from seod.gateway.process import main

sys.exit(main())
