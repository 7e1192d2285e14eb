"""Add the gizmo to the filter menu. Untested in Nuke; see ``bokehnet_nuke.py``."""

import nuke

nuke.menu("Nodes").addCommand("Filter/bokehnet", "nuke.createNode('bokehnet')")
