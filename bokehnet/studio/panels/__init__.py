"""Settings on the page of the studio: panels of fields, and their form as command, script or preset."""
