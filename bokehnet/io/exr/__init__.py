"""OpenEXR files at byte level: stored headers and deep samples."""
