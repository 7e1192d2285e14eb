"""Tools of the maintainers: releases, recipes of packages, pinned depth networks."""
