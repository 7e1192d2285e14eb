"""Not run in Nuke; see ``bokehnet_nuke.py``. Adds the gizmo to the menu of filters."""

import nuke

nuke.menu("Nodes").addCommand("Filter/bokehnet", "nuke.createNode('bokehnet')")
