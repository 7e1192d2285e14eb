"""``bokehnet compare``: the command, and the page with a slider."""
