"""``bokehnet trace``: the command, and its tiles on a cluster."""
