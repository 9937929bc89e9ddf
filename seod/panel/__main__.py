"""`python -m seod.panel`."""

import sys

from seod.panel.process import main

sys.exit(main())
