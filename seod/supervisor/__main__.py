"""`python -m seod.supervisor`: what `seod run` becomes."""

import sys

from seod.supervisor.process import main

sys.exit(main())
